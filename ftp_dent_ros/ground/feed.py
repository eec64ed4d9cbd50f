"""What one ground has got and gets next."""

from __future__ import annotations

import heapq
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from ftp_dent_ros.ground import difference
from ftp_dent_ros.ground.frames import WINDOW, Name, Piece, Report
from ftp_dent_ros.ground.item import REPLACED, Importance
from ftp_dent_ros.ground.pace import Mark, Pace
from ftp_dent_ros.ground.store import Kept, Store

# Without a report for so long nothing more is sent.
SILENCE = 3.0
# Seconds that are waited at most for news of what is under way.
_MOST_PATIENCE = 5.0
_CROWD = 1000  # items in line before those that are gone are swept out


@dataclass
class _Progress:
    """How far an item is sent: what was lost on the way, and where the rest begins."""

    kept: Kept
    data: bytes
    gaps: list[tuple[int, int]]
    whole: bytes
    acknowledged: int = 0


@dataclass(frozen=True)
class _UnderWay:
    sequence: int
    kept: Kept
    offset: int
    size: int
    mark: Mark
    was_full: bool


class Feed:
    """One ground's share of the store, a piece at a time; not for several threads at once.

    Parameters
    ----------
    ground : bytes
    instance : int
        Of the ground's program.
    link : int
        Names this feed in its pieces.
    store : Store
    pace : Pace
    now : callable
        Monotonic time, seconds.
    """

    def __init__(
        self,
        ground: bytes,
        instance: int,
        link: int,
        store: Store,
        pace: Pace,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.ground, self.instance, self.link = ground, instance, link
        # Starts of the ground's program before this one.
        self.former: deque[int] = deque(maxlen=8)
        self.pace = pace
        self.lost = self.sent_pieces = self.sent_bytes = 0
        self.delivered: dict[Importance, int] = dict.fromkeys(Importance, 0)
        self._store = store
        self._now = now
        self._heard = now()
        self._sequence = 0
        self._under_way: deque[_UnderWay] = deque()
        self._bytes_under_way = 0
        self._waiting: list[tuple[int, int, Name, Kept]] = []
        self._crowded = _CROWD
        self._progress: dict[Name, _Progress] = {}
        # Of each topic whose items replace each other: its last one's turn, in order of sending.
        self._turns: dict[str, int] = {}
        self._last_news = now()
        self._trials = 0
        # The last item of each topic that the ground has, and its number.
        self._references: dict[str, tuple[int, bytes]] = {}

    @property
    def silence(self) -> float:
        """Seconds since the last report."""
        return self._now() - self._heard

    def offer(self, kept: Kept) -> None:
        """An item is to be sent here."""
        kept.owed.add(self.ground)
        kept.claimed = True
        # One of each waits: topics take turns, or those with the newest stamps would be all.
        takes_turns = kept.importance in REPLACED
        order = self._turns.get(kept.topic, 0) if takes_turns else -kept.stamp_ns
        heapq.heappush(self._waiting, (int(kept.importance), order, kept.name, kept))
        if len(self._waiting) > self._crowded:
            # What was replaced meanwhile must not pile up in a long silence.
            self._waiting = [entry for entry in self._waiting if not entry[-1].gone]
            heapq.heapify(self._waiting)
            self._crowded = 2 * len(self._waiting) + _CROWD

    @property
    def waiting(self) -> dict[Importance, int]:
        """How many items are still to be sent or acknowledged, by importance."""
        counts = dict.fromkeys(Importance, 0)
        for *_, kept in self._waiting:
            counts[kept.importance] += not kept.gone
        for progress in self._progress.values():
            counts[progress.kept.importance] += 1
        return counts

    def restart(self, instance: int, link: int) -> None:
        """The ground's program was started anew: what it had in part is lost."""
        for progress in self._progress.values():
            self.offer(progress.kept)
        self.former.append(self.instance)
        self.instance, self.link, self._sequence = instance, link, 0
        self._under_way.clear()
        self._bytes_under_way = 0
        self._progress.clear()
        self._references.clear()

    def next_piece(self) -> tuple[Piece, float] | None:
        """Piece to send now, or None; with the seconds that its sending has to wait yet.

        If those are not 0 the piece is only announced, and has to be asked for again.
        """
        self._lose_if_old()
        size = self.pace.piece
        full = self._bytes_under_way + size > self.pace.window and self._under_way
        if full or len(self._under_way) >= WINDOW or self.silence > SILENCE:
            return None
        progress = self._choose()
        if progress is None:
            return None
        kept = progress.kept
        start, end = progress.gaps[0]
        size = min(size, end - start)
        wait = self.pace.wait(size)
        piece = Piece(
            kept.name,
            self.link,
            self._sequence + 1,
            len(progress.data),
            start,
            progress.data[start : start + size],
        )
        if wait > 0:
            return piece, wait
        if start + size < end:
            progress.gaps[0] = start + size, end
        else:
            del progress.gaps[0]
        self._sequence += 1
        self.sent_pieces += 1
        self.sent_bytes += size
        was_full = bool(self._waiting or any(each.gaps for each in self._progress.values()))
        if not self._under_way:
            self._last_news = self._now()
        mark = self.pace.sent(size, not self._under_way)
        self._under_way.append(_UnderWay(self._sequence, kept, start, size, mark, was_full))
        self._bytes_under_way += size
        return piece, 0.0

    def take(self, report: Report) -> list[Kept]:
        """Learn what has arrived; the items that are whole there now."""
        self._heard = self._now()
        if report.link != self.link:
            return []  # It has heard nothing of this feed yet.
        done: list[Kept] = []
        while self._under_way and self._under_way[0].sequence <= report.sequence:
            flight = self._under_way.popleft()
            self._bytes_under_way -= flight.size
            self._last_news, self._trials = self._now(), 0
            age = report.sequence - flight.sequence
            if age < WINDOW and report.received >> age & 1:
                self.pace.acknowledged(flight.size, flight.mark, flight.was_full)
                done += self._arrived(flight)
            else:
                self._send_again(flight)
        return done

    def _arrived(self, flight: _UnderWay) -> list[Kept]:
        progress = self._progress.get(flight.kept.name)
        if progress is None:
            return []
        progress.acknowledged += flight.size
        if progress.acknowledged < len(progress.data):
            return []
        del self._progress[flight.kept.name]
        if len(progress.whole) <= difference.LARGEST and flight.kept.name.boot == self._store.boot:
            self._references[flight.kept.topic] = flight.kept.name.number, progress.whole
        flight.kept.owed.discard(self.ground)
        self.delivered[flight.kept.importance] += 1
        return [flight.kept]

    def _send_again(self, flight: _UnderWay) -> None:
        self.lost += 1
        progress = self._progress.get(flight.kept.name)
        if progress is not None:
            progress.gaps.insert(0, (flight.offset, flight.offset + flight.size))

    def _lose_if_old(self) -> None:
        """Of the last pieces before a pause no later one tells that they were lost.

        The next time twice as much patience is had.
        """
        patience = self.pace.patience(self._bytes_under_way) * 2**self._trials
        if self._under_way and self._now() - self._last_news > min(patience, _MOST_PATIENCE):
            self._trials += 1
            while self._under_way:
                self._send_again(self._under_way.pop())
            self._bytes_under_way = 0
            self._last_news = self._now()

    def _choose(self) -> _Progress | None:
        """Most important item with something to send; one that is begun is finished first."""
        begun = [each for each in self._progress.values() if each.gaps]
        first = min(begun, key=lambda each: each.kept.importance, default=None)
        while self._waiting:
            importance, *_, kept = self._waiting[0]
            if first is not None and first.kept.importance <= importance:
                return first
            heapq.heappop(self._waiting)
            data = None if kept.gone else self._store.read(kept)
            if data is not None:
                kept.begun = True
                if kept.importance in REPLACED:
                    self._turns[kept.topic] = self._sequence + 1
                sent = self._shortened(kept, data)
                progress = _Progress(kept, sent, [(0, len(sent))], data)
                self._progress[kept.name] = progress
                return progress
        return first

    def _shortened(self, kept: Kept, data: bytes) -> bytes:
        if kept.importance > Importance.PREVIEWS:
            return difference.as_it_is(data)
        known = kept.name.boot == self._store.boot
        number, reference = self._references.get(kept.topic, (0, b'')) if known else (0, b'')
        return difference.shortened(data, number, reference)
