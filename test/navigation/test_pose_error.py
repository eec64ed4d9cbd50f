"""The pose's error that a bad clock and a bad link leave, at 2 m/s and 60 degrees a second."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from itertools import count

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_pose_history import Circle
from test_vehicle import MS, READY, START, S, gps_raw_int, heartbeat

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import frames
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings
from ftp_dent_ros.navigation.vehicle import Vehicle

SECONDS = 24
UPTIME = 100 * S


class Sky:
    """A vehicle on a circle, its clock, and the link to it; time is ROS time since the start."""

    def __init__(self, steps: dict[float, float]) -> None:
        self.random = np.random.default_rng(6)
        self.steps = steps
        self.circle = Circle()
        self.vehicle = Vehicle(VehicleSettings())
        self._sender = mavlink.MAVLink(None, 1, 1)
        self._events: list = []
        self._order = count()

    def boot(self, now: int) -> int:
        """Its clock: 50 ppm fast, and stepping."""
        stepped = sum(round(by * S) for at, by in self.steps.items() if now >= at * S)
        return UPTIME + now + 50 * now // 1_000_000 + stepped

    def delay(self) -> int:
        """A few milliseconds, and in bursts of 0.3 s up to a hundred."""
        burst = self.random.uniform(0, 100) if self._now // (S // 10) % 15 < 3 else 0
        return round(1e6 * (self.random.gamma(1.0, 2.0) + 0.2 + burst))

    def fly(self) -> Iterator[Instant]:
        """Every 10 ms, after all that had come by then."""
        for self._now in range(0, SECONDS * S, 10 * MS):
            self._speak()
            while self._events and self._events[0][0] <= self._now:
                arrival, _, message = heapq.heappop(self._events)
                at = Instant(START + arrival, arrival / S)
                self.vehicle.receive(message, at)
            at = Instant(START + self._now, self._now / S)
            for request in self.vehicle.requests(at):
                there = self._now + self.delay()
                if request.get_type() == 'TIMESYNC':
                    reply = mavlink.MAVLink_timesync_message(self.boot(there), request.ts1)
                    self._send(reply, there + self.delay())
                else:
                    result = mavlink.MAV_RESULT_ACCEPTED
                    ack = mavlink.MAVLink_command_ack_message(request.command, result)
                    self._send(ack, there + self.delay())
            yield at

    def _speak(self) -> None:
        now, boot_ms = self._now, self.boot(self._now) // MS
        messages = []
        if now % S == 0:
            messages.append(heartbeat())
        if now % (200 * MS) == 0:
            ratio = 1e-13 * (now % S)
            report = mavlink.MAVLink_ekf_status_report_message(READY, ratio, 0, ratio, 0, 0)
            messages += [report, gps_raw_int(1000 * boot_ms)]
        if now % (20 * MS) == 0:
            turn = frames.ned_attitude(self.circle.attitude(now).as_quat())
            rates = frames.flu_from_frd(self.circle.body_rate(now))
            place = frames.enu_from_ned(self.circle.position(now))
            speed = frames.enu_from_ned(self.circle.velocity(now))
            messages.append(mavlink.MAVLink_attitude_quaternion_message(boot_ms, *turn, *rates))
            messages.append(mavlink.MAVLink_local_position_ned_message(boot_ms, *place, *speed))
        arrival = now + self.delay()
        for message in messages:
            self._send(message, arrival)

    def _send(self, message, arrival: int) -> None:
        (heard,) = mavlink.MAVLink(None).parse_buffer(message.pack(self._sender))
        heapq.heappush(self._events, (arrival, next(self._order), heard))


def test_skew_steps_and_jitter_leave_millimetres() -> None:
    steps = {8: 0.06, 13: -0.15, 17: 0.02, 21: -0.02}
    sky, errors, ratios = Sky(steps), [], []
    waiting: list[int] = []
    for at in sky.fly():
        if at.steady > 4:
            waiting.append(at.ros - round(sky.random.uniform(0, 10 * MS)))
        is_asked = at.ros // (10 * MS) % 10 == 0
        for stamp in waiting[:] if is_asked else ():
            try:
                tag = sky.vehicle.tag_at(stamp, at)
            except PoseAwaitedError:
                if at.ros - stamp < S:
                    continue
            except PoseError:
                pass
            else:
                off = tag.pose.translation - sky.circle.position(stamp - START)
                turn = sky.circle.attitude(stamp - START)
                turned = (tag.pose.rotation * turn.inv()).as_rotvec()
                errors.append((np.linalg.norm(off), np.degrees(np.linalg.norm(turned))))
                deviations = np.sqrt(np.diag(tag.covariance))
                ratios.append(np.abs([*off, *turned]) / deviations)
            waiting.remove(stamp)
    position, angle = np.transpose(errors)
    asked = (SECONDS - 4.0) * 100
    assert len(errors) > 0.85 * asked
    assert sky.vehicle.clock.steps == len(steps)
    assert np.median(position) < 0.003 and np.median(angle) < 0.08
    # Half of it is the stamps, which are whole milliseconds.
    assert position.max() < 0.005 and angle.max() < 0.1
    assert np.mean(np.array(ratios) < 2) > 0.99
