"""The drone's end: keeps what the payload gives and feeds it to each ground that reports."""

from __future__ import annotations

import heapq
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground.commands import CHANNEL, Executive
from ftp_dent_ros.ground.link import Link
from ftp_dent_ros.ground.pace import Mark, Pace
from ftp_dent_ros.ground.protocol import (
    LARGEST_REFERENCE,
    REPLACED,
    SILENCE,
    WINDOW,
    Importance,
    Item,
    Name,
    Piece,
    Report,
    deflate,
    wrap,
)
from ftp_dent_ros.ground.store import Kept, Store

_CROWD = 1000  # items in line before those that are gone are swept out
_POLL = 0.1  # seconds


@dataclass
class _Progress:
    """How far an item is sent: what is still to be sent of its bytes as they cross the air."""

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
        self.is_forgotten = False
        self.lost = self.sent_pieces = 0
        self._store = store
        self._now = now
        self._heard = now()
        self._sequence = 0
        self._under_way: deque[_UnderWay] = deque()
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

    @property
    def _bytes_under_way(self) -> int:
        return sum(each.size for each in self._under_way)

    def offer(self, kept: Kept) -> None:
        """An item is to be sent here."""
        kept.owed.add(self.ground)
        # One of each waits: topics take turns, or those with the newest stamps would be all.
        takes_turns = kept.importance in REPLACED
        order = self._turns.get(kept.topic, 0) if takes_turns else -kept.stamp_ns
        heapq.heappush(self._waiting, (int(kept.importance), order, kept.name, kept))
        if len(self._waiting) > self._crowded:
            # What was replaced meanwhile must not pile up in a long silence.
            self._waiting = [entry for entry in self._waiting if not entry[-1].gone]
            heapq.heapify(self._waiting)
            self._crowded = 2 * len(self._waiting) + _CROWD

    def restart(self, instance: int, link: int) -> None:
        """The ground's program was started anew: what it had in part is lost."""
        for progress in self._progress.values():
            self.offer(progress.kept)
        self.former.append(self.instance)
        self.instance, self.link, self._sequence = instance, link, 0
        self._under_way.clear()
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
        was_full = bool(self._waiting or any(each.gaps for each in self._progress.values()))
        if not self._under_way:
            self._last_news = self._now()
        mark = self.pace.sent(size, not self._under_way)
        self._under_way.append(_UnderWay(self._sequence, kept, start, size, mark, was_full))
        return piece, 0.0

    def take(self, report: Report) -> list[Kept]:
        """Learn what has arrived; the items that are whole there now."""
        self._heard = self._now()
        if report.link != self.link:
            return []  # It has heard nothing of this feed yet.
        done: list[Kept] = []
        now, flights = self._now(), list(self._under_way)
        # What stands before a piece in a queue holds it up, too.
        overdue = self.pace.longest_trip + self._bytes_under_way / self.pace.rate
        self._under_way.clear()
        for flight in flights:
            age = report.sequence - flight.sequence
            if 0 <= age < WINDOW and report.received >> age & 1:
                self._last_news, self._trials = now, 0
                self.pace.acknowledged(flight.size, flight.mark, flight.was_full)
                done += self._arrived(flight)
            elif age >= WINDOW or (age > 0 and now > flight.mark.sent_at + overdue):
                self._send_again(flight)
            else:  # a later piece may have overtaken it
                self._under_way.append(flight)
        return done

    def _arrived(self, flight: _UnderWay) -> list[Kept]:
        progress = self._progress.get(flight.kept.name)
        if progress is None:
            return []
        progress.acknowledged += flight.size
        if progress.acknowledged < len(progress.data):
            return []
        del self._progress[flight.kept.name]
        kept = flight.kept
        if len(progress.whole) <= LARGEST_REFERENCE and kept.name.boot == self._store.boot:
            self._references[kept.topic] = kept.name.number, progress.whole
        kept.owed.discard(self.ground)
        return [kept]

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
        if self._under_way and self._now() - self._last_news > min(patience, 5.0):
            self._trials += 1
            while self._under_way:
                self._send_again(self._under_way.pop())
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
                sent = self._deflate(kept, data)
                progress = _Progress(kept, sent, [(0, len(sent))], data)
                self._progress[kept.name] = progress
                return progress
        return first

    def _deflate(self, kept: Kept, data: bytes) -> bytes:
        if kept.importance > Importance.PREVIEWS:
            return wrap(data)
        if kept.name.boot != self._store.boot:
            return deflate(data)
        return deflate(data, *self._references.get(kept.topic, (0, b'')))


class Drone:
    """Items to grounds, as each one's link allows.

    Parameters
    ----------
    link : Link
    folder : Path or None
        Where items are kept until they are delivered; None for memory.
    room : int
        Bytes that they may take up.
    limit : float
        byte/s that must never be exceeded, for each ground; 0 for none.
    executive : Executive
        Of the commands.
    """

    def __init__(
        self, link: Link, folder: Path | None, room: int, limit: float, executive: Executive
    ) -> None:
        self.refused = 0
        self._same_name = float('-inf')
        self._link = link
        self._limit = limit
        self._store = Store(folder, room, secrets.randbits(63))
        self._feeds: dict[bytes, Feed] = {}
        self._latest: dict[str, Kept] = {}
        self._changed = threading.Condition()
        self._stop = False
        self._threads: list[threading.Thread] = []
        link.on('up', self._take)
        link.answer(CHANNEL, executive.reply)

    def put(self, item: Item) -> None:
        """Send an item to all grounds, now or later; never waits for a link."""
        kept = self._store.put(item)
        with self._changed:
            if item.latest:
                before = self._latest.get(item.topic)
                if before is not None and not before.owed:
                    self._store.remove(before)
                self._latest[item.topic] = kept
            self._forget_grounds()
            for feed in self._feeds.values():
                feed.offer(kept)
            self._changed.notify_all()

    def rate(self) -> float:
        """byte/s of the slowest link that is heard; 0 if none is."""
        with self._changed:
            heard = [feed.pace.rate for feed in self._feeds.values() if feed.silence < SILENCE]
        return min(heard, default=0.0)

    def state(self) -> dict[str, str]:
        """What there is to say about the link, by name."""
        with self._changed:
            feeds = list(self._feeds.values())
            waiting = {each.name.lower(): self._store.waiting(each) for each in Importance}
        heard = [feed for feed in feeds if feed.silence < SILENCE]
        sent = sum(feed.sent_pieces for feed in feeds)
        lost = sum(feed.lost for feed in feeds)
        return {
            'grounds': str(len(heard)),
            'grounds out of reach': str(len(feeds) - len(heard)),
            'rate (kbit/s)': f'{8e-3 * min((f.pace.rate for f in heard), default=0.0):.0f}',
            'round trip (ms)': f'{1e3 * max((f.pace.trip for f in heard), default=0.0):.0f}',
            'pieces sent': str(sent),
            'pieces sent again (%)': f'{100 * lost / max(sent, 1):.1f}',
            **{f'waiting: {name}': str(count) for name, count in waiting.items()},
            'waiting (MB)': f'{self._store.size / 1e6:.1f}',
            'dropped for want of room': str(self._store.dropped),
            'not on disk (it is full)': str(self._store.unwritten),
            'refused': str(self.refused),
        }

    def trouble(self) -> str:
        """What the user should mend, in a sentence; else nothing."""
        if self._store.unwritten:
            return 'the disk is full: what is kept for the ground is lost with a restart'
        if time.monotonic() - self._same_name < SILENCE:
            return 'two grounds have the same name: start each with a --station of its own'
        return ''

    def close(self) -> None:
        """End the threads; what was not delivered stays on disk."""
        with self._changed:
            self._stop = True
            self._changed.notify_all()
        for thread in self._threads:
            thread.join(6.0)
        self._link.close()

    def _take(self, data: bytes) -> None:
        try:
            report = Report.unpack(data)
        except CodecError:
            self.refused += 1
            return
        with self._changed:
            feed = self._feeds.get(report.ground)
            if feed is None:
                feed = self._new_feed(report)
                if feed is None:
                    self.refused += 1
                    return
            elif feed.instance != report.instance:
                if report.instance in feed.former and feed.silence < SILENCE:
                    # Two that are taken for one would be started anew with every report.
                    self._same_name = time.monotonic()
                    return
                feed.restart(report.instance, secrets.randbits(32))
                self._offer_latest(feed)
            for kept in feed.take(report):
                # A list is kept for those who come later.
                if not kept.owed and self._latest.get(kept.topic) is not kept:
                    self._store.remove(kept)
            self._changed.notify_all()

    def _new_feed(self, report: Report) -> Feed | None:
        self._forget_grounds()
        if len(self._feeds) >= 8:
            return None
        feed = Feed(
            report.ground, report.instance, secrets.randbits(32), self._store, Pace(self._limit)
        )
        for kept in self._store:
            if not kept.owed:
                feed.offer(kept)
        self._feeds[report.ground] = feed
        self._offer_latest(feed)
        thread = threading.Thread(
            target=self._send, args=(feed,), name=f'link {len(self._threads)}', daemon=True
        )
        self._threads.append(thread)
        thread.start()
        return feed

    def _offer_latest(self, feed: Feed) -> None:
        for kept in self._latest.values():
            if feed.ground not in kept.owed and not kept.gone:
                feed.offer(kept)

    def _forget_grounds(self) -> None:
        """What a ground is owed that has been silent for an hour goes to the next."""
        for ground, feed in list(self._feeds.items()):
            if feed.silence > 3600:
                del self._feeds[ground]
                feed.is_forgotten = True
                for kept in self._store:
                    kept.owed.discard(ground)

    def _send(self, feed: Feed) -> None:
        """Send what is next, in the feed's thread: it may wait for its connection, no other."""
        channel = f'down/{feed.ground.hex()}'
        while True:
            with self._changed:
                if self._stop or feed.is_forgotten:
                    return
                found = feed.next_piece()
                if found is None:
                    self._changed.wait(_POLL)
                    continue
            piece, wait = found
            if wait > 0:
                time.sleep(min(wait, _POLL))
                continue
            self._link.send(channel, piece.pack())
