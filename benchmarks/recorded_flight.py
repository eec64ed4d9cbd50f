"""A recorded flight through the link's logic in virtual time, and how good its poses are.

A log answers nobody. TIMESYNC is answered on the recorded vehicle's own boot clock, as its
recorded answers to another client show it, and commands are acknowledged.
"""

from __future__ import annotations

import heapq
import lzma
import struct
from collections import Counter
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation, Slerp

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import frames
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings
from ftp_dent_ros.navigation.vehicle import Vehicle
from ftp_dent_ros.pose import Pose

_PATIENCE = 1_000_000_000
_RETRY = 50_000_000
VEHICLE = (1, 1)
# TIMESYNC shows the recorded vehicle's clock as it was a few milliseconds before.
_STAMPED_LATER = 7_000_000
_EARTH_RADIUS, _ECCENTRICITY_SQUARED = 6378137.0, 6.69437999014e-3  # WGS 84


@dataclass
class Flight:
    """Packets of a .tlog file, packed (.xz) or not.

    Times are nanoseconds on the clock of the recording computer.
    """

    times: list[int] = field(default_factory=list)
    packets: list[bytes] = field(default_factory=list)
    messages: list[mavlink.MAVLink_message] = field(default_factory=list)

    @classmethod
    def read(cls, path: Path) -> Flight:
        data, at, flight = path.read_bytes(), 0, cls()
        if path.suffix == '.xz':
            data = lzma.decompress(data)
        parser = mavlink.MAVLink(None)
        while at < len(data):
            (microseconds,) = struct.unpack_from('>Q', data, at)
            magic, length, flags = data[at + 8 : at + 11]
            size = length + (12 + 13 * (flags & 1) if magic == 0xFD else 8)
            packet = data[at + 8 : at + 8 + size]
            (message,) = parser.parse_buffer(packet)
            flight.times.append(1000 * microseconds)
            flight.packets.append(packet)
            flight.messages.append(message)
            at += 8 + size
        flight._read_boot_clock()
        return flight

    def of(self, name: str) -> list[tuple[int, mavlink.MAVLink_message]]:
        """Messages of the vehicle's of one type, with their times."""
        return [
            (stamp, message)
            for stamp, message in zip(self.times, self.messages, strict=True)
            if message.get_type() == name
            and (message.get_srcSystem(), message.get_srcComponent()) == VEHICLE
        ]

    def _read_boot_clock(self) -> None:
        """Follow the vehicle's clock only as far as what was recorded forces it to go.

        It was read after the question was sent and before the answer came, so that an answer
        that came late says little; what the vehicle stamped came no earlier than its stamp.
        Where these bounds exclude what they were before, the clock has truly stepped or halted.
        """
        start, asked = self.times[0], dict[int, int]()
        times, behind = [0], list[int]()
        for stamp, message in zip(self.times, self.messages, strict=True):
            name = message.get_type()
            if name == 'TIMESYNC' and not message.tc1:
                asked[message.ts1] = stamp
            if (message.get_srcSystem(), message.get_srcComponent()) != VEHICLE:
                continue
            if name == 'TIMESYNC' and message.tc1 and message.ts1 in asked:
                lower, upper = asked[message.ts1] - message.tc1, stamp - message.tc1
            elif name in ('ATTITUDE_QUATERNION', 'LOCAL_POSITION_NED') and behind:
                lower, upper = -(2**63), stamp - 1_000_000 * message.time_boot_ms + _STAMPED_LATER
            else:
                continue
            behind.append(min(max(behind[-1] if behind else upper, lower), upper))
            times.append(stamp - start)
        self._clock_times = np.array(times, float)
        self._clock_behind = np.array([behind[0], *behind], float) - start

    def boot_ns(self, stamp: int) -> int:
        """The vehicle's time since boot at a time of the recording."""
        at = stamp - self.times[0]
        return int(at - np.interp(at, self._clock_times, self._clock_behind))

    def truth(self) -> Truth:
        """The simulator's own record of the flight (SIM_STATE)."""
        _, origin = self.of('GPS_GLOBAL_ORIGIN')[-1]
        records = self.of('SIM_STATE')
        states = [message for _, message in records]
        latitude = np.radians(1e-7 * origin.latitude)
        curve = 1 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
        meridian = _EARTH_RADIUS * (1 - _ECCENTRICITY_SQUARED) / curve**1.5
        parallel = _EARTH_RADIUS / np.sqrt(curve) * np.cos(latitude)
        north = np.radians([1e-7 * (s.lat_int - origin.latitude) for s in states]) * meridian
        east = np.radians([1e-7 * (s.lon_int - origin.longitude) for s in states]) * parallel
        up = np.array([s.alt for s in states]) - 1e-3 * origin.altitude
        return Truth(
            [stamp for stamp, _ in records],
            np.stack([north, east, -up], axis=1),
            np.array([(s.q1, s.q2, s.q3, s.q4) for s in states]),
        )


@dataclass(frozen=True)
class Truth:
    """Where the vehicle truly was.

    Attributes
    ----------
    times : list of int
        When each record came, nanoseconds on the clock of the recording computer.
    position : ndarray, shape (n, 3)
        North, east, down from the estimator's origin, metres.
    attitude : ndarray, shape (n, 4)
        w, x, y, z; FRD -> NED.
    """

    times: list[int]
    position: np.ndarray
    attitude: np.ndarray


def answer(message: mavlink.MAVLink_message, boot_ns: int) -> mavlink.MAVLink_message | None:
    """What the vehicle sends back to a message, at a time since its boot."""
    if message.get_type() == 'TIMESYNC' and message.tc1 == 0:
        return mavlink.MAVLink_timesync_message(tc1=boot_ns, ts1=message.ts1)
    if message.get_type() == 'COMMAND_LONG':
        return mavlink.MAVLink_command_ack_message(
            message.command,
            mavlink.MAV_RESULT_ACCEPTED,
            target_system=message.get_srcSystem(),
            target_component=message.get_srcComponent(),
        )
    return None


@dataclass
class Outcome:
    """What a flight gave; stamps are times of the recording in nanoseconds."""

    tags: dict[int, Pose] = field(default_factory=dict)
    covariances: dict[int, np.ndarray] = field(default_factory=dict)
    refusals: dict[int, str] = field(default_factory=dict)
    stream: dict[int, Pose] = field(default_factory=dict)
    vehicle: Vehicle | None = None
    figures: dict[str, str] = field(default_factory=dict)

    def reasons(self) -> Counter[str]:
        return Counter(self.refusals.values())


def replay(
    flight: Flight, stamps: list[int], seed: int = 1, settings: VehicleSettings | None = None
) -> Outcome:
    """Play all packets, answer TIMESYNC after random delays, ask for the pose at each stamp."""
    rng = np.random.default_rng(seed)
    vehicle, outcome = Vehicle(settings or VehicleSettings()), Outcome()
    ours, its = mavlink.MAVLink(None, *VEHICLE[:1], 191), mavlink.MAVLink(None, *VEHICLE)
    order = count()
    events = [(stamp, next(order), flight.messages[i]) for i, stamp in enumerate(flight.times)]
    heapq.heapify(events)
    asked, waiting, retry = iter(stamps), list[int](), 0
    upcoming = next(asked, None)
    while events:
        now, _, message = heapq.heappop(events)
        at = Instant(now, now / 1e9)
        vehicle.receive(message, at)
        for request in vehicle.requests(at):
            there, back = rng.uniform(0.2e6, 2.5e6, 2)
            (heard,) = mavlink.MAVLink(None).parse_buffer(request.pack(ours))
            reply = answer(heard, flight.boot_ns(round(now + there)))
            (returned,) = mavlink.MAVLink(None).parse_buffer(reply.pack(its))
            heapq.heappush(events, (round(now + there + back), next(order), returned))
        outcome.stream.update(vehicle.new_poses(at))
        while upcoming is not None and upcoming <= now:
            waiting.append(upcoming)
            upcoming = next(asked, None)
        if now > retry:
            retry = now + _RETRY
            waiting = [stamp for stamp in waiting if not _settled(vehicle, stamp, at, outcome)]
    outcome.vehicle, outcome.figures = vehicle, vehicle.figures(at)
    return outcome


def _settled(vehicle: Vehicle, stamp: int, at: Instant, outcome: Outcome) -> bool:
    try:
        tag = vehicle.tag_at(stamp, at)
        outcome.tags[stamp], outcome.covariances[stamp] = tag.pose, tag.covariance
    except PoseAwaitedError as error:
        if at.ros - stamp < _PATIENCE:
            return False
        outcome.refusals[stamp] = error.reason
    except PoseError as error:
        outcome.refusals[stamp] = error.reason
    return True


@dataclass(frozen=True)
class Errors:
    """Errors of poses: north, east, down in metres, shape (n, 3); attitude in degrees, (n,)."""

    position: np.ndarray
    angle: np.ndarray

    def within(self, mask: np.ndarray) -> Errors:
        return Errors(self.position[mask], self.angle[mask])

    def rms(self) -> tuple[np.ndarray, float]:
        return np.sqrt(np.mean(self.position**2, axis=0)), float(np.sqrt(np.mean(self.angle**2)))

    def largest(self, percentile: float = 100) -> tuple[np.ndarray, float]:
        return (
            np.percentile(np.abs(self.position), percentile, axis=0),
            float(np.percentile(self.angle, percentile)),
        )


def compare(poses: list[Pose], position: np.ndarray, attitude: np.ndarray) -> Errors:
    """Errors of poses against positions (NED) and attitudes (w, x, y, z; FRD -> NED)."""
    found = frames.enu_from_ned([pose.translation for pose in poses])
    wxyz = frames.ned_attitude([pose.quaternion for pose in poses])
    turned = Rotation.from_quat(np.roll(wxyz, -1, axis=1))
    given = Rotation.from_quat(np.roll(attitude, -1, axis=1))
    return Errors(found - position, np.degrees((turned.inv() * given).magnitude()))


def own_poses(flight: Flight, stamps: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """The log's own samples, interpolated at times of the recording: NED and (w, x, y, z)."""
    attitudes, positions = flight.of('ATTITUDE_QUATERNION'), flight.of('LOCAL_POSITION_NED')
    boot_ms = np.array([flight.boot_ns(stamp) for stamp in stamps]) / 1e6
    turns = Slerp(
        [m.time_boot_ms for _, m in attitudes],
        Rotation.from_quat([(m.q2, m.q3, m.q4, m.q1) for _, m in attitudes]),
    )
    at = [m.time_boot_ms for _, m in positions]
    position = [np.interp(boot_ms, at, [getattr(m, k) for _, m in positions]) for k in 'xyz']
    return np.stack(position, axis=1), np.roll(turns(boot_ms).as_quat(), 1, axis=1)
