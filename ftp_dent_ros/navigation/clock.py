"""The autopilot's clock against this computer's: exchanges of TIMESYNC, and what they prove."""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.report import number
from ftp_dent_ros.navigation.settings import MOST_CLOCK_ERROR

SECOND = 1_000_000_000
MILLISECOND = 1_000_000

# Exchanges that a line through them needs before it is believed.
_MINIMUM_EXCHANGES = 5


class Exchange(NamedTuple):
    """One request and its answer; all in nanoseconds."""

    sent: int
    boot: int
    received: int


@dataclass
class Segment:
    """Exchanges that agree, the first at `begin`: no clock has stepped between any two of them."""

    begin: int
    exchanges: deque[Exchange] = field(default_factory=lambda: deque(maxlen=64))

    @property
    def last(self) -> Exchange:
        """The latest exchange; until it was sent no clock has stepped."""
        return self.exchanges[-1]

    def offset(self, at: int) -> tuple[int, int]:
        """Offset and its uncertainty, nanoseconds, at a ROS time."""
        lower, upper = -(2**63), 2**63
        for exchange in self.exchanges:
            # Two crystals drift apart by 200 ppm at most (common ones: 50 ppm each).
            drift = abs(at - exchange.received) // 5000
            lower = max(lower, exchange.sent - exchange.boot - drift)
            upper = min(upper, exchange.received - exchange.boot + drift)
        # Bounds that cross, by less than the tolerance, leave as much doubt as bounds apart.
        return (lower + upper) // 2, abs(upper - lower) // 2

    def contradiction(self, exchange: Exchange) -> int:
        """By how much, ns, an exchange after these cannot be of the same clocks; 0 if it can."""
        offset, uncertainty = self.offset(exchange.received)
        lower, upper = exchange.sent - exchange.boot, exchange.received - exchange.boot
        # An autopilot reads its clock between two rounds of its scheduler: 5 ms are no step.
        tolerance = uncertainty + 5 * MILLISECOND
        return max(0, abs(offset - min(max(offset, lower), upper)) - tolerance)


class ClockOffset:
    """Follows the clock of one autopilot.

    Parameters
    ----------
    period : float
        Time between two requests, seconds.
    maximum_error : float
        Largest uncertainty at which a stamp is still converted, seconds.

    Attributes
    ----------
    steps, restarts : int
        How often a clock stepped, and the time since boot started anew.
    """

    def __init__(self, period: float = 0.1, maximum_error: float = 0.01) -> None:
        self._period = round(period * SECOND)
        self._maximum_error = round(maximum_error * SECOND)
        self._segments: deque[Segment] = deque(maxlen=8)
        self._open_requests: deque[int] = deque(maxlen=64)
        self._last_request = -(2**63)
        self._round_trips: deque[int] = deque(maxlen=20)
        self.steps = self.restarts = 0

    def request(self, now: int) -> int | None:
        """`ts1` of a request to send now (ROS time in ns), or None while none is due."""
        if 0 <= now - self._last_request < self._period:
            return None
        self._last_request = now
        self._open_requests.append(now)
        return now

    def answer(self, tc1: int, ts1: int, now: int) -> int | None:
        """Take a TIMESYNC message of the autopilot's that arrived now.

        A request (tc1 = 0) and an answer to anybody else's request teach nothing.

        Returns
        -------
        int or None
            From which time since boot on, in nanoseconds, times come twice, because the
            autopilot's clock has stepped back: 0 if the time since boot has started anew (or this
            computer's clock has been set, which looks the same). Usually None.
        """
        if tc1 <= 0 or ts1 not in self._open_requests:
            return None
        # An answer that was overtaken is not waited for: exchanges stay in order.
        while self._open_requests.popleft() != ts1:
            pass
        exchange, round_trip = Exchange(ts1, tc1, now), now - ts1
        if round_trip < 0:
            return None
        self._round_trips.append(round_trip)
        if round_trip > 2 * self._maximum_error:
            return None  # It bounds the offset too loosely to be of use.
        off = self._segments[-1].contradiction(exchange) if self._segments else 0
        repeated = None
        if off > SECOND:
            self.restarts += 1
            self._segments.clear()
            repeated = 0
        elif off:
            self.steps += 1
            newest = self._segments[-1]
            if exchange.sent - exchange.boot > newest.offset(now)[0]:
                repeated = exchange.boot - (exchange.received - newest.last.sent)
        if off or not self._segments:
            self._segments.append(Segment(now))
        self._segments[-1].exchanges.append(exchange)
        return repeated

    def boot_time(self, stamp: int) -> tuple[int, int]:
        """Autopilot's time since boot at a ROS time, and its uncertainty; nanoseconds.

        Raises
        ------
        PoseAwaitedError
            No exchange after `stamp` is there yet, or too few to trust.
        PoseError
            A clock stepped around `stamp`, or the offset was not known then.
        """
        if not self._segments:
            raise PoseAwaitedError(self._unknown(), 'clock not converged')
        newest = self._segments[-1]
        if stamp > newest.last.sent:
            raise PoseAwaitedError(
                'no TIMESYNC answer from after the stamp has come yet', 'clock awaited'
            )
        if stamp < self._segments[0].begin:
            raise PoseError(
                "the autopilot's clock was not known yet at that time", 'clock not converged'
            )
        holders = [part for part in self._segments if part.begin <= stamp <= part.last.sent]
        if len(holders) != 1:
            raise PoseError('a clock stepped around that time', 'clock stepped')
        offset, uncertainty = holders[0].offset(stamp)
        if not self._is_known(holders[0], uncertainty):
            error = PoseAwaitedError if holders[0] is newest else PoseError
            raise error(self._unknown(), 'clock not converged')
        return stamp - offset, uncertainty

    def ros_time(self, boot: int) -> int | None:
        """ROS time of a recent time since boot, both in ns; None until that is known."""
        if not self._segments:
            return None
        offset, uncertainty = self._latest()
        return boot + offset if self._is_known(self._segments[-1], uncertainty) else None

    def recent(self, boot: int, wrap: int, now: int) -> int | None:
        """Time since boot in ns of a message that has come now, past the wraps of its counter.

        None before the first exchange, and for a time that is not of this flight.
        """
        if not self._segments:
            return None
        last = self._segments[-1].last
        boot_now = last.boot + now - last.received
        boot += round((boot_now - boot) / wrap) * wrap
        return boot if -SECOND // 2 < boot_now - boot < 10 * SECOND else None

    def is_converged(self, now: int) -> bool:
        """Whether the offset is known and was confirmed of late, at a ROS time."""
        is_known = self.ros_time(0) is not None
        return is_known and now - self._segments[-1].last.received < 2 * SECOND

    @property
    def offset(self) -> float | None:
        """ROS time less time since boot, seconds."""
        return self._latest()[0] / SECOND if self._segments else None

    def figures(self, now: int) -> dict[str, str]:
        """What is known of it, at a ROS time."""
        uncertainty = self._latest()[1] if self._segments else None
        median = statistics.median(self._round_trips) if self._round_trips else None
        return {
            'clock converged': str(self.is_converged(now)).lower(),
            'clock offset (s)': number(self.offset, 6),
            'clock uncertainty (ms)': number(uncertainty, 3, 1e-6),
            'round trip (ms)': number(median, 3, 1e-6),
            'least round trip (ms)': number(min(self._round_trips, default=None), 3, 1e-6),
            'clock steps': str(self.steps),
            'clock restarts': str(self.restarts),
        }

    def _latest(self) -> tuple[int, int]:
        """Offset and its uncertainty at the latest exchange."""
        newest = self._segments[-1]
        return newest.offset(newest.last.received)

    def _is_known(self, segment: Segment, uncertainty: int) -> bool:
        is_seen_often = len(segment.exchanges) >= _MINIMUM_EXCHANGES
        return is_seen_often and uncertainty <= self._maximum_error

    def _unknown(self) -> str:
        """Why the offset is not known, and what to do about it."""
        if not self._round_trips:
            return 'the autopilot does not answer TIMESYNC: its clock is not known'
        quickest = min(self._round_trips)
        if quickest <= 2 * self._maximum_error:
            return "the autopilot's clock is not known well enough yet: wait some seconds"
        # A fifth more than the best uncertainty, in whole steps.
        allowed = math.ceil(1.2 * quickest / 2 / SECOND / 0.005) * 0.005
        remedy = f', or set maximum_clock_error to {allowed:.3f}'
        return (
            f"the autopilot's clock is known to within {quickest / 2 / MILLISECOND:.0f} ms only, "
            f'for the quickest answers to TIMESYNC take {quickest / MILLISECOND:.0f} ms: make the '
            f'link quicker{remedy if allowed <= MOST_CLOCK_ERROR else ""}'
        )
