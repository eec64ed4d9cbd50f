"""A recorded flight through the link's logic in virtual time, and how good its poses are."""

from __future__ import annotations

import heapq
from collections import Counter
from dataclasses import dataclass, field
from itertools import count

import numpy as np
from flight_player import VEHICLE, Flight, answer
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation, Slerp

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import frames
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings
from ftp_dent_ros.navigation.vehicle import Vehicle
from ftp_dent_ros.pose import Pose

_PATIENCE = 1_000_000_000
_RETRY = 50_000_000


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
