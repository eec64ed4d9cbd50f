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
_WRAP = 2**32 * MILLISECOND


class Exchange(NamedTuple):
    """One request and its answer; all in nanoseconds."""

    sent: int
    boot: int
    received: int


@dataclass
class Segment:
    """Exchanges that agree: no clock has stepped between any two of them."""

    begin: int
    exchanges: deque[Exchange] = field(default_factory=lambda: deque(maxlen=64))
    latest: tuple[int, int] = (0, 0)

    def add(self, exchange: Exchange) -> None:
        """Take an exchange that does not contradict those before it."""
        self.exchanges.append(exchange)
        self.latest = self.offset(exchange.received)

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
    repeated_from : int or None
        If the last answer showed that the autopilot's clock has stepped back: the first time since
        boot, in nanoseconds, that may have come twice.
    answers, steps, restarts : int
        How often an answer came, a clock stepped, and the time since boot started anew.
    """

    def __init__(self, period: float = 0.1, maximum_error: float = 0.01) -> None:
        self._period = round(period * SECOND)
        self._maximum_error = round(maximum_error * SECOND)
        self._segments: deque[Segment] = deque(maxlen=8)
        self._open_requests: deque[int] = deque(maxlen=64)
        self._last_request: int | None = None
        self._round_trips: deque[int] = deque(maxlen=20)
        self.answers = self.steps = self.restarts = 0
        self.repeated_from: int | None = None

    def request(self, now: int) -> int | None:
        """`ts1` of a request to send now (ROS time in ns), or None while none is due."""
        last = self._last_request
        if last is not None and 0 <= now - last < self._period:
            return None
        self._last_request = now
        self._open_requests.append(now)
        return now

    def answer(self, tc1: int, ts1: int, now: int) -> bool:
        """Take a TIMESYNC message of the autopilot's that arrived now.

        A request (tc1 = 0) and an answer to anybody else's request teach nothing.

        Returns
        -------
        bool
            Whether this shows that the time since boot has started anew: the autopilot has
            rebooted (or this computer's clock has been set, which looks the same).
        """
        if tc1 <= 0 or ts1 not in self._open_requests:
            return False
        # An answer that was overtaken is not waited for: exchanges stay in order.
        while self._open_requests.popleft() != ts1:
            pass
        exchange, round_trip = Exchange(ts1, tc1, now), now - ts1
        if round_trip < 0:
            return False
        self.answers += 1
        self.repeated_from = None
        self._round_trips.append(round_trip)
        if round_trip > 2 * self._maximum_error:
            return False  # It bounds the offset too loosely to be of use.
        newest = self._segments[-1] if self._segments else None
        off = newest.contradiction(exchange) if newest else 0
        # A larger step: the autopilot has rebooted, or this computer's clock has been set.
        if off > SECOND:
            self.restarts += 1
            self._segments.clear()
        elif newest and off:
            self.steps += 1
            if exchange.sent - exchange.boot > newest.offset(now)[0]:
                self.repeated_from = exchange.boot - (exchange.received - newest.last.sent)
        if off or not self._segments:
            self._segments.append(Segment(now))
        self._segments[-1].add(exchange)
        return off > SECOND

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
        if len(holders[0].exchanges) < _MINIMUM_EXCHANGES or uncertainty > self._maximum_error:
            error = PoseAwaitedError if holders[0] is newest else PoseError
            raise error(self._unknown(), 'clock not converged')
        return stamp - offset, uncertainty

    def ros_time(self, boot: int) -> int | None:
        """ROS time of a recent time since boot, both in ns; None until that is known."""
        return boot + self._segments[-1].latest[0] if self._is_known() else None

    def unwrap(self, time_boot_ms: int, now: int) -> int | None:
        """Time since boot in ns, past the wrap of `time_boot_ms` after 49.7 days.

        None before the first exchange, and for a time that is not of this flight.
        """
        if not self._segments:
            return None
        boot = time_boot_ms * MILLISECOND
        boot += (self._boot_now(now) - boot + _WRAP // 2) // _WRAP * _WRAP
        return boot if self.is_plausible(boot, now) else None

    def is_plausible(self, boot: int, now: int) -> bool:
        """Whether a time since boot in ns can be that of a message that has come now."""
        if not self._segments:
            return False
        return -10 * SECOND < boot - self._boot_now(now) < SECOND // 2

    def is_converged(self, now: int) -> bool:
        """Whether the offset is known and was confirmed of late, at a ROS time."""
        return self._is_known() and now - self._segments[-1].last.received < 2 * SECOND

    @property
    def offset(self) -> float | None:
        """ROS time less time since boot, seconds."""
        return self._segments[-1].latest[0] / SECOND if self._segments else None

    def figures(self, now: int) -> dict[str, str]:
        """What is known of it, at a ROS time."""
        uncertainty = self._segments[-1].latest[1] if self._segments else None
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

    def _unknown(self) -> str:
        """Why the offset is not known, and what to do about it."""
        if not self.answers:
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

    def _is_known(self) -> bool:
        if not self._segments:
            return False
        newest = self._segments[-1]
        return (
            len(newest.exchanges) >= _MINIMUM_EXCHANGES and newest.latest[1] <= self._maximum_error
        )

    def _boot_now(self, now: int) -> int:
        last = self._segments[-1].last
        return last.boot + now - last.received
