"""The autopilot's clock against this computer's: exchanges of TIMESYNC, and what they prove."""

from __future__ import annotations

import statistics
from collections import deque
from dataclasses import dataclass, field

from ftp_dent_ros.errors import PoseAwaitedError, PoseError

SECOND = 1_000_000_000
MILLISECOND = 1_000_000

# How far two crystals drift apart, with margin (common ones: 50 ppm each).
_DRIFT_PPM = 200
# An autopilot reads its clock between two rounds of its scheduler: this much is no step.
_TOLERANCE = 5 * MILLISECOND
_KEPT_EXCHANGES = 64

# Exchanges that a line through them needs before it is believed.
_MINIMUM_EXCHANGES = 5
# Of the past that stamps may still come from, and of requests that may still be answered.
_KEPT_SEGMENTS = 8
_KEPT_REQUESTS = 64
# Round trips that the diagnostics tell of.
_RECENT = 20
# Without an exchange for so long the clocks do not count as matched, nanoseconds.
_SILENCE = 2 * SECOND
# A larger step: the autopilot has rebooted, or this computer's clock has been set.
_RESTART = 1 * SECOND
# Segments that ended longer ago are of no use to any cloud.
_FORGOTTEN = 60 * SECOND
# A `time_boot_ms` further back, or ahead, of the present is none of this flight.
_PLAUSIBLE_AGE = 10 * SECOND
_PLAUSIBLE_LEAD = SECOND // 2
_WRAP = 2**32 * MILLISECOND


@dataclass(frozen=True)
class Exchange:
    """One request and its answer; all in nanoseconds."""

    sent: int
    boot: int
    received: int

    @property
    def round_trip(self) -> int:
        """Time from the request to its answer."""
        return self.received - self.sent


@dataclass
class Segment:
    """Exchanges that agree: no clock has stepped between any two of them."""

    begin: int
    exchanges: deque[Exchange] = field(default_factory=lambda: deque(maxlen=_KEPT_EXCHANGES))
    count: int = 0
    is_tight: bool = False
    latest: tuple[int, int] = (0, 0)

    def add(self, exchange: Exchange) -> None:
        """Take an exchange that does not contradict those before it."""
        self.exchanges.append(exchange)
        self.count += 1
        self.latest = self.offset(exchange.received)

    @property
    def last(self) -> Exchange:
        """The latest exchange."""
        return self.exchanges[-1]

    @property
    def end(self) -> int:
        """Until when no clock has stepped, ROS time in nanoseconds."""
        return self.last.sent

    def offset(self, at: int) -> tuple[int, int]:
        """Offset and its uncertainty, nanoseconds, at a ROS time."""
        lower, upper = -(2**63), 2**63
        for exchange in self.exchanges:
            drift = abs(at - exchange.received) * _DRIFT_PPM // 1_000_000
            lower = max(lower, exchange.sent - exchange.boot - drift)
            upper = min(upper, exchange.received - exchange.boot + drift)
        # Bounds that cross, by less than the tolerance, leave as much doubt as bounds apart.
        return (lower + upper) // 2, abs(upper - lower) // 2

    def contradiction(self, exchange: Exchange) -> int:
        """By how much, ns, an exchange after these cannot be of the same clocks; 0 if it can."""
        offset, uncertainty = self.offset(exchange.received)
        lower, upper = exchange.sent - exchange.boot, exchange.received - exchange.boot
        return max(0, abs(offset - min(max(offset, lower), upper)) - uncertainty - _TOLERANCE)


@dataclass(frozen=True)
class ClockState:
    """What is known of the autopilot's clock; times in seconds.

    Attributes
    ----------
    round_trip, least_round_trip : float or None
        Median and least of the last exchanges.
    silence : float or None
        Time since the last one.
    maximum_error : float
        Largest uncertainty at which a stamp is still converted.
    """

    converged: bool
    offset: float | None
    uncertainty: float | None
    round_trip: float | None
    answers: int
    steps: int
    restarts: int
    least_round_trip: float | None = None
    silence: float | None = None
    maximum_error: float = 0.0


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
    """

    def __init__(self, period: float = 0.1, maximum_error: float = 0.01) -> None:
        self._period = round(period * SECOND)
        self._maximum_error = round(maximum_error * SECOND)
        self._segments: deque[Segment] = deque(maxlen=_KEPT_SEGMENTS)
        self._open_requests: dict[int, None] = {}
        self._last_request: int | None = None
        self._round_trips: deque[int] = deque(maxlen=_RECENT)
        self._answers = self._steps = self._restarts = self._answered = 0
        self.repeated_from: int | None = None

    def request(self, now: int) -> int | None:
        """`ts1` of a request to send now (ROS time in ns), or None while none is due."""
        last = self._last_request
        if last is not None and 0 <= now - last < self._period:
            return None
        self._last_request = now
        self._open_requests[now] = None
        while len(self._open_requests) > _KEPT_REQUESTS:
            del self._open_requests[next(iter(self._open_requests))]
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
        while next(iter(self._open_requests)) != ts1:
            del self._open_requests[next(iter(self._open_requests))]
        del self._open_requests[ts1]
        exchange = Exchange(ts1, tc1, now)
        if exchange.round_trip < 0:
            return False
        self._answers += 1
        self._answered = now
        self.repeated_from = None
        self._round_trips.append(exchange.round_trip)
        is_tight = exchange.round_trip <= 2 * self._maximum_error
        newest = self._segments[-1] if self._segments else None
        off = newest.contradiction(exchange) if newest else 0
        restarted = off > _RESTART
        if restarted:
            self._restarts += 1
            self._segments.clear()
        elif newest and off:
            self._steps += 1
            if exchange.sent - exchange.boot > newest.offset(now)[0]:
                self.repeated_from = exchange.boot - (exchange.received - newest.end)
            self._segments.append(Segment(now))
        elif newest and newest.is_tight and not is_tight:
            return False
        elif newest and is_tight and not newest.is_tight:
            self._segments[-1] = Segment(now)
        if not self._segments:
            self._segments.append(Segment(now))
        self._segments[-1].add(exchange)
        self._segments[-1].is_tight = is_tight
        while abs(now - self._segments[0].end) > _FORGOTTEN:
            self._segments.popleft()
        return restarted

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
            raise PoseAwaitedError(
                'the autopilot has not answered TIMESYNC yet: its clock is not known',
                'clock not converged',
            )
        newest = self._segments[-1]
        if stamp > newest.end:
            raise PoseAwaitedError(
                'no TIMESYNC answer from after the stamp has come yet', 'clock awaited'
            )
        if stamp < self._segments[0].begin:
            raise PoseError(
                "the autopilot's clock was not known yet at that time", 'clock not converged'
            )
        holders = [part for part in self._segments if part.begin <= stamp <= part.end]
        if len(holders) != 1:
            raise PoseError('a clock stepped around that time', 'clock stepped')
        offset, uncertainty = holders[0].offset(stamp)
        if holders[0].count < _MINIMUM_EXCHANGES or uncertainty > self._maximum_error:
            error = PoseAwaitedError if holders[0] is newest else PoseError
            raise error(
                f"the offset to the autopilot's clock is only known to within "
                f'{uncertainty / MILLISECOND:.1f} ms after {holders[0].count} TIMESYNC answers, '
                f'more than maximum_clock_error allows ({self._maximum_error / MILLISECOND:g} ms)',
                'clock not converged',
            )
        return stamp - offset, uncertainty

    def ros_time(self, boot: int) -> int | None:
        """ROS time of a recent time since boot, both in ns; None until that is known."""
        if not self._segments or not self._is_converged(self._segments[-1]):
            return None
        return boot + self._segments[-1].latest[0]

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
        return -_PLAUSIBLE_AGE < boot - self._boot_now(now) < _PLAUSIBLE_LEAD

    def state(self, now: int) -> ClockState:
        """State at a ROS time."""
        if not self._segments:
            return ClockState(False, None, None, None, self._answers, self._steps, self._restarts)
        newest = self._segments[-1]
        last = newest.last
        offset, uncertainty = newest.latest
        return ClockState(
            self._is_converged(newest) and now - last.received < _SILENCE,
            offset / SECOND,
            uncertainty / SECOND,
            statistics.median(self._round_trips) / SECOND,
            self._answers,
            self._steps,
            self._restarts,
            min(self._round_trips) / SECOND,
            (now - self._answered) / SECOND,
            self._maximum_error / SECOND,
        )

    def _is_converged(self, segment: Segment) -> bool:
        return segment.count >= _MINIMUM_EXCHANGES and segment.latest[1] <= self._maximum_error

    def _boot_now(self, now: int) -> int:
        last = self._segments[-1].last
        return last.boot + now - last.received
