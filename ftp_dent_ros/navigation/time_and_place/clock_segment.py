"""Exchanges of TIMESYNC that agree with each other."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

SECOND = 1_000_000_000
MILLISECOND = 1_000_000

# How far two crystals drift apart, with margin (common ones: 50 ppm each).
_DRIFT_PPM = 200
# An autopilot reads its clock between two rounds of its scheduler: this much is no step.
_TOLERANCE = 5 * MILLISECOND
_KEPT_EXCHANGES = 64


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
