"""How much may be in flight: the rate that a link delivers, and its round trip.

After BBR (Cardwell et al., ACM Queue 14(5), 2016), on pieces of items: what is in flight can no
longer be overtaken by what is more important. So no more is than the link carries in a round trip,
and a little. The round trip is that of pieces which found no queue: a long trip through an empty
link is jitter. A loss slows nothing down: radios lose without being full.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

# Seconds that a round trip is taken for until one is known.
_FIRST_TRIP = 0.2
# Seconds between two looks at how short a round trip is without a queue.
_BETWEEN_DRAINS = 15.0


class SentMark(NamedTuple):
    """The state of a delivery's measurement when a piece was sent.

    Attributes
    ----------
    size : int
        Bytes of the piece.
    is_full : bool
        Whether more was waiting to be sent; if not, a low rate says nothing.
    """

    size: int
    is_full: bool
    sent_at: float
    delivered: int
    delivered_at: float
    first_sent_at: float
    is_unqueued: bool


class Pace:
    """Judges a link by its acknowledgements.

    Parameters
    ----------
    limit : float
        byte/s that must never be exceeded; 0 for none.
    now : callable
        Monotonic time, seconds.
    """

    def __init__(self, limit: float = 0.0, now: Callable[[], float] = time.monotonic) -> None:
        self.limit = limit
        self._now = now
        self._rates: deque[tuple[float, float]] = deque()
        self._unqueued: deque[tuple[float, float]] = deque()
        self._delivered = 0
        self._delivered_at = self._first_sent_at = now()
        # The first rate may be far too high for a slow link: what waits there is looked for soon.
        self._drained_at = now() + 2.0 - _BETWEEN_DRAINS
        self._free_at = now()

    @property
    def rate(self) -> float:
        """byte/s that the link carries, as far as is known."""
        # In the beginning below the slowest radio of use.
        best = max((rate for _, rate in self._rates), default=6_000.0)
        return min(best, self.limit) if self.limit else best

    @property
    def trip(self) -> float:
        """Mean round trip of late where nothing was queued, seconds."""
        trips = [trip for _, trip in self._unqueued] or [_FIRST_TRIP]
        return sum(trips) / len(trips)

    @property
    def longest_trip(self) -> float:
        """Longest round trip of late where nothing was queued, seconds."""
        return max((trip for _, trip in self._unqueued), default=_FIRST_TRIP)

    def _drains(self, now: float) -> bool:
        return now < self._drained_at + max(2 * self.trip, 0.1)

    @property
    def window(self) -> int:
        """Bytes that may be in flight."""
        # Over what the link holds in a round trip, to find more; at times under it, to see how
        # short a trip is without what waits before it.
        gain = 0.5 if self._drains(self._now()) else 1.25
        return max(2 * self.piece, round(gain * self.rate * self.trip) + self.piece)

    @property
    def piece(self) -> int:
        """Bytes of a piece: short, so that what is more important need not wait."""
        # Of 20 ms; of one packet where a link is slow, so that a loss costs little; six at most.
        return round(min(max(0.02 * self.rate, 800), 8_000))

    def patience(self, in_flight: int) -> float:
        """Seconds within which news must come of so many bytes in flight, twice over."""
        if not self._unqueued:
            return 5.0
        # So late a busy computer's news may be.
        return 0.2 + 2 * (self.trip + in_flight / self.rate)

    @property
    def wait(self) -> float:
        """Seconds until the next piece may go, for the limit's sake."""
        return max(0.0, self._free_at - self._now())

    def sent(self, size: int, alone: bool, is_full: bool) -> SentMark:
        """Note what was sent; what it returns goes with the acknowledgement.

        Parameters
        ----------
        size : int
            Bytes.
        alone : bool
            Whether nothing else was in flight.
        is_full : bool
            Whether more was waiting to be sent.
        """
        now = self._now()
        if self.limit:
            # A tenth of a second may be saved up.
            self._free_at = max(self._free_at, now - 0.1) + size / self.limit
        if alone:
            self._delivered_at = self._first_sent_at = now
        is_unqueued = alone or (self._drains(now) and now > self._drained_at + self.trip)
        before = self._delivered, self._delivered_at, self._first_sent_at
        return SentMark(size, is_full, now, *before, is_unqueued)

    def acknowledged(self, mark: SentMark) -> None:
        """Note the delivery of what `sent` returned the mark of."""
        now = self._now()
        self._delivered += mark.size
        self._delivered_at, self._first_sent_at = now, mark.sent_at
        trip = max(now - mark.sent_at, 1e-4)
        if mark.is_unqueued:
            self._unqueued.append((now, trip))
        # What had to wait before the link tells its rate, whether more came after it or not.
        is_full = mark.is_full or trip > 2 * self.longest_trip
        # Acknowledgements may come in a heap after a stall, but none faster than it was sent.
        took = max(now - mark.delivered_at, mark.sent_at - mark.first_sent_at, 1e-4)
        rate = (self._delivered - mark.delivered) / took
        if is_full or rate > self.rate:
            self._rates.append((now, rate))
        _forget(self._unqueued, now - 30)
        _forget(self._rates, now - max(2.0, 10 * self.trip))
        # Only what may yet be the best one is kept.
        while len(self._rates) > 1 and self._rates[-2][1] <= self._rates[-1][1]:
            del self._rates[-2]
        if now > self._drained_at + _BETWEEN_DRAINS:
            self._drained_at = now


def _forget(values: deque[tuple[float, float]], since: float) -> None:
    """Drop what was noted before a time, but for the last one."""
    while len(values) > 1 and values[0][0] < since:
        values.popleft()
