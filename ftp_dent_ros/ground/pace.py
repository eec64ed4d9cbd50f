"""How much may be under way: the rate that a link delivers, and its shortest round trip.

After BBR (Cardwell et al., ACM Queue 14(5), 2016), on whole messages: the transport below has its
own congestion control, but whatever it has taken can no longer be overtaken by what is more
important. So no more is handed to it than the link carries in a round trip, and a little.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

# Seconds that the fastest delivery and the shortest round trip count.
_MEMORY_OF_RATE = 8.0
_MEMORY_OF_TRIP = 30.0
# Over what the link holds in a round trip: to find more, and in the beginning to find it fast.
_GAIN, _FIRST_GAIN = 1.25, 2.5
_GROWTH = 1.25
_FIRST_RATE = 6_000.0  # byte/s, below the slowest radio of use
# Of sending, for one piece; and bytes of the smallest and the largest.
_PIECE_SECONDS = 0.04
_SMALLEST_PIECE, _LARGEST_PIECE = 400, 16_000


class Mark(NamedTuple):
    """The state of a delivery's measurement when a piece was sent."""

    sent_at: float
    delivered: int
    delivered_at: float
    first_sent_at: float


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
        self._trips: deque[tuple[float, float]] = deque()
        self._delivered = 0
        self._delivered_at = self._first_sent_at = now()
        self._growing = True
        self._best = 0.0
        self._since_growth = 0
        self._budget = 0.0
        self._budget_at = now()

    @property
    def rate(self) -> float:
        """byte/s that the link carries, as far as is known."""
        best = max((rate for _, rate in self._rates), default=_FIRST_RATE)
        return min(best, self.limit) if self.limit else best

    @property
    def trip(self) -> float:
        """Shortest round trip of late, seconds."""
        return min((trip for _, trip in self._trips), default=0.2)

    @property
    def window(self) -> int:
        """Bytes that may be under way."""
        gain = _FIRST_GAIN if self._growing else _GAIN
        return max(2 * self.piece, round(gain * self.rate * self.trip) + self.piece)

    @property
    def piece(self) -> int:
        """Bytes of a piece: short, so that what is more important need not wait."""
        return round(min(max(self.rate * _PIECE_SECONDS, _SMALLEST_PIECE), _LARGEST_PIECE))

    def wait(self, size: int) -> float:
        """Seconds until so many bytes may go, for the limit's sake."""
        if not self.limit:
            return 0.0
        now = self._now()
        # A piece of a tenth of a second may be saved up.
        most = max(0.1 * self.limit, float(size))
        self._budget = min(self._budget + (now - self._budget_at) * self.limit, most)
        self._budget_at = now
        return max(0.0, (size - self._budget) / self.limit)

    def sent(self, size: int, alone: bool) -> Mark:
        """Note what was sent; what it returns goes with the acknowledgement.

        Parameters
        ----------
        size : int
            Bytes.
        alone : bool
            Whether nothing else was under way.
        """
        now = self._now()
        self._budget -= size
        if alone:
            self._delivered_at = self._first_sent_at = now
        return Mark(now, self._delivered, self._delivered_at, self._first_sent_at)

    def acknowledged(self, size: int, mark: Mark, was_full: bool) -> None:
        """Note a delivery.

        Parameters
        ----------
        size : int
            Bytes.
        mark : Mark
            What `sent` returned.
        was_full : bool
            Whether more was waiting to be sent then; if not, a low rate says nothing.
        """
        now = self._now()
        self._delivered += size
        self._delivered_at, self._first_sent_at = now, mark.sent_at
        self._trips.append((now, max(now - mark.sent_at, 1e-4)))
        # Acknowledgements may come in a heap after a stall, but none faster than it was sent.
        took = max(now - mark.delivered_at, mark.sent_at - mark.first_sent_at, 1e-4)
        rate = (self._delivered - mark.delivered) / took
        if was_full or rate > self.rate:
            self._rates.append((now, rate))
        while self._trips and self._trips[0][0] < now - _MEMORY_OF_TRIP:
            self._trips.popleft()
        while len(self._rates) > 1 and self._rates[0][0] < now - _MEMORY_OF_RATE:
            self._rates.popleft()
        # Only what may yet be the best one is kept.
        while len(self._rates) > 1 and self._rates[-2][1] <= self._rates[-1][1]:
            del self._rates[-2]
        while len(self._trips) > 1 and self._trips[-2][1] >= self._trips[-1][1]:
            del self._trips[-2]
        self._judge_growth(was_full)

    def _judge_growth(self, was_full: bool) -> None:
        if not self._growing or not was_full:
            return
        if self.rate > _GROWTH * self._best:
            self._best, self._since_growth = self.rate, 0
        else:
            self._since_growth += 1
        self._growing = self._since_growth < 12
