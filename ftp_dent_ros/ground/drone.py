"""The drone's end: keeps what the payload gives and feeds it to each ground that reports."""

from __future__ import annotations

import contextlib
import heapq
import os
import re
import secrets
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ftp_dent_ros.errors import CodecError, ConfigurationError
from ftp_dent_ros.ground.commands import CHANNEL, Executive
from ftp_dent_ros.ground.link import GroundLink
from ftp_dent_ros.ground.pace import Pace, SentMark
from ftp_dent_ros.ground.protocol import (
    LARGEST_ITEM,
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

_CROWD = 1000  # items in line before those that are gone are swept out
_POLL = 0.1  # seconds


@dataclass(eq=False)
class StoredItem:
    """An item that is kept.

    Attributes
    ----------
    name : Name
    importance : Importance
    stamp_ns : int
    topic : str
        '' for one that was found on disk.
    size : int
        Bytes.
    data : bytes or None
        The packed item; None if it is on disk, or gone.
    latest : bool
    owed : set of bytes
        Grounds that it is promised to and that have not got it.
    begun, gone : bool
        Whether some of it has been sent, and whether it is kept no longer.
    """

    name: Name
    importance: Importance
    stamp_ns: int
    topic: str
    size: int
    data: bytes | None = None
    latest: bool = False
    owed: set[bytes] = field(default_factory=set)
    begun: bool = False
    gone: bool = False

    @property
    def is_replaced(self) -> bool:
        """Whether the next one of its topic takes its place."""
        return self.latest or self.importance in REPLACED


class Store:
    """Items by name, the least important and oldest dropped when there is no room.

    State, previews and lists are kept in memory alone: another start has newer ones.

    Parameters
    ----------
    folder : Path or None
        Made if it is not there; None keeps all in memory.
    limit : int
        Bytes of all items.
    boot : int
        Of this program's start.

    Attributes
    ----------
    dropped : int
        Items that were given up.
    unwritten : int
        Items that are in memory alone, for the disk is full.

    Raises
    ------
    ConfigurationError
        The folder cannot be written.
    """

    def __init__(self, folder: Path | None, limit: int, boot: int) -> None:
        self.dropped = self.unwritten = self.size = 0
        self.boot = boot
        self._folder = folder
        self._limit = limit
        self._number = 0
        self._kept: dict[Name, StoredItem] = {}
        self._lock = threading.RLock()
        if folder is None:
            return
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as reason:
            raise ConfigurationError(
                f'{folder}: cannot keep items there ({reason.strerror}): choose another folder'
            ) from None
        for path in sorted(folder.iterdir()):
            self._find(path)

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[StoredItem]:
        with self._lock:
            return iter(list(self._kept.values()))

    def put(self, item: Item) -> StoredItem:
        """Keep an item, and drop what it takes the place of."""
        data = item.pack()
        with self._lock:
            self._number += 1
            name = Name(self.boot, self._number)
            kept = StoredItem(
                name, item.importance, item.stamp_ns, item.topic, len(data), data, item.latest
            )
            if kept.is_replaced:
                for other in self:
                    if other.topic == item.topic and not other.begun:
                        self.remove(other)
            self._kept[name] = kept
            self.size += kept.size
        if self._folder is not None and not kept.is_replaced:
            self._write(kept, data)
        with self._lock:
            while self.size > self._limit and len(self._kept) > 1:
                # The least important, of these the oldest.
                self.remove(max(self._kept.values(), key=lambda k: (k.importance, -k.stamp_ns)))
                self.dropped += 1
        return kept

    def read(self, kept: StoredItem) -> bytes | None:
        """Bytes of an item, or None if it is no longer there."""
        data = kept.data
        if data is not None or kept.gone:
            return data
        try:
            data = self._path(kept).read_bytes()
            Item.unpack(data)
        except (OSError, CodecError):
            self.remove(kept)
            self.dropped += 1
            return None
        return data

    def remove(self, kept: StoredItem) -> None:
        """Forget an item that is delivered or of no more use."""
        with self._lock:
            if self._kept.pop(kept.name, None) is None:
                return
            kept.gone = True
            self.size -= kept.size
            is_on_disk, kept.data = kept.data is None, None
        if is_on_disk:
            with contextlib.suppress(OSError):
                self._path(kept).unlink(missing_ok=True)

    def waiting(self, importance: Importance) -> int:
        """How many items of an importance are kept."""
        return sum(kept.importance == importance for kept in self)

    def _path(self, kept: StoredItem) -> Path:
        assert self._folder is not None
        stem = f'{int(kept.importance)}_{kept.stamp_ns}_{kept.name.boot:x}_{kept.name.number}'
        return self._folder / f'{stem}.item'

    def _write(self, kept: StoredItem, data: bytes) -> None:
        """Write an item; if the disk is full it stays in memory as long as there is room."""
        path = self._path(kept)
        aside = path.with_suffix('.part')
        try:
            aside.write_bytes(data)
            os.replace(aside, path)
        except OSError:
            self.unwritten += 1
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
            return
        with self._lock:
            kept.data = None
            if kept.gone:  # removed meanwhile
                path.unlink(missing_ok=True)

    def _find(self, path: Path) -> None:
        """Take up a file of an earlier start; halves and strangers' are left out."""
        match = re.fullmatch(r'([0-5])_(\d+)_([0-9a-f]+)_(\d+)\.item', path.name)
        if path.suffix == '.part':
            path.unlink(missing_ok=True)
        size = path.stat().st_size if match else 0
        if match is None or size > LARGEST_ITEM:
            return
        name = Name(int(match[3], 16), int(match[4]))
        self._kept[name] = StoredItem(name, Importance(int(match[1])), int(match[2]), '', size)
        self.size += size


@dataclass
class _Progress:
    """How far an item is sent: what is still to be sent of its bytes as they cross the air."""

    kept: StoredItem
    data: bytes
    gaps: list[tuple[int, int]]
    whole: bytes
    acknowledged: int = 0


@dataclass(frozen=True)
class _InFlight:
    sequence: int
    progress: _Progress
    offset: int
    size: int
    mark: SentMark
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
        self._in_flight: deque[_InFlight] = deque()
        self._waiting: list[tuple[int, int, Name, StoredItem]] = []
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
    def _bytes_in_flight(self) -> int:
        return sum(each.size for each in self._in_flight)

    def offer(self, kept: StoredItem) -> None:
        """An item is to be sent here."""
        kept.owed.add(self.ground)
        # One of each waits: topics take turns, or those with the newest stamps would be all.
        takes_turns = kept.importance in REPLACED
        order = self._turns.get(kept.topic, 0) if takes_turns else -kept.stamp_ns
        heapq.heappush(self._waiting, (int(kept.importance), order, kept.name, kept))
        if len(self._waiting) > 2 * len(self._store) + _CROWD:
            # What was replaced meanwhile must not pile up in a long silence.
            self._waiting = [entry for entry in self._waiting if not entry[-1].gone]
            heapq.heapify(self._waiting)

    def next_piece(self) -> tuple[Piece, float] | None:
        """Piece to send now, or None; with the seconds that its sending has to wait yet.

        If those are not 0 the piece is only announced, and has to be asked for again.
        """
        self._lose_if_old()
        size = self.pace.piece
        full = self._bytes_in_flight + size > self.pace.window and self._in_flight
        if full or len(self._in_flight) >= WINDOW or self.silence > SILENCE:
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
        if not self._in_flight:
            self._last_news = self._now()
        mark = self.pace.sent(size, not self._in_flight)
        self._in_flight.append(_InFlight(self._sequence, progress, start, size, mark, was_full))
        return piece, 0.0

    def take(self, report: Report) -> list[StoredItem]:
        """Learn what has arrived; the items that are whole there now."""
        self._heard = self._now()
        if report.link != self.link:
            return []  # It has heard nothing of this feed yet.
        done: list[StoredItem] = []
        now, flights = self._now(), list(self._in_flight)
        # What stands before a piece in a queue holds it up, too.
        overdue = self.pace.longest_trip + self._bytes_in_flight / self.pace.rate
        self._in_flight.clear()
        for flight in flights:
            age = report.sequence - flight.sequence
            if 0 <= age < WINDOW and report.received >> age & 1:
                self._last_news, self._trials = now, 0
                self.pace.acknowledged(flight.size, flight.mark, flight.was_full)
                done += self._arrived(flight)
            elif age >= WINDOW or (age > 0 and now > flight.mark.sent_at + overdue):
                self._send_again(flight)
            else:  # a later piece may have overtaken it
                self._in_flight.append(flight)
        return done

    def _arrived(self, flight: _InFlight) -> list[StoredItem]:
        """Each byte is in a gap, in flight or acknowledged: the last one makes its item whole."""
        progress, kept = flight.progress, flight.progress.kept
        progress.acknowledged += flight.size
        if progress.acknowledged < len(progress.data):
            return []
        del self._progress[kept.name]
        if len(progress.whole) <= LARGEST_REFERENCE and kept.name.boot == self._store.boot:
            self._references[kept.topic] = kept.name.number, progress.whole
        kept.owed.discard(self.ground)
        return [kept]

    def _send_again(self, flight: _InFlight) -> None:
        self.lost += 1
        flight.progress.gaps.insert(0, (flight.offset, flight.offset + flight.size))

    def _lose_if_old(self) -> None:
        """Of the last pieces before a pause no later one tells that they were lost.

        The next time twice as much patience is had.
        """
        patience = self.pace.patience(self._bytes_in_flight) * 2**self._trials
        if self._in_flight and self._now() - self._last_news > min(patience, 5.0):
            self._trials += 1
            while self._in_flight:
                self._send_again(self._in_flight.pop())
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
                if kept.importance > Importance.PREVIEWS:  # compressed in its own format
                    sent = wrap(data)
                else:
                    sent = deflate(data, *self._references.get(kept.topic, (0, b'')))
                progress = _Progress(kept, sent, [(0, len(sent))], data)
                self._progress[kept.name] = progress
                return progress
        return first


class Drone:
    """Items to grounds, as each one's link allows.

    Parameters
    ----------
    link : GroundLink
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
        self, link: GroundLink, folder: Path | None, room: int, limit: float, executive: Executive
    ) -> None:
        self.refused = 0
        self._same_name = float('-inf')
        self._link = link
        self._limit = limit
        self._store = Store(folder, room, secrets.randbits(63))
        self._feeds: dict[bytes, Feed] = {}
        self._latest: dict[str, StoredItem] = {}
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
            if feed is None or feed.instance != report.instance:
                if feed and report.instance in feed.former and feed.silence < SILENCE:
                    # Two that are taken for one would be started anew with every report.
                    self._same_name = time.monotonic()
                    return
                feed = self._new_feed(report, feed)
                if feed is None:
                    self.refused += 1
                    return
            for kept in feed.take(report):
                # A list is kept for those who come later.
                if not kept.owed and self._latest.get(kept.topic) is not kept:
                    self._store.remove(kept)
            self._changed.notify_all()

    def _new_feed(self, report: Report, before: Feed | None) -> Feed | None:
        """Feed of a ground, or of one that was started anew: what it had in part is lost."""
        self._forget_grounds()
        if before is None and len(self._feeds) >= 8:
            return None
        feed = Feed(
            report.ground, report.instance, secrets.randbits(32), self._store, Pace(self._limit)
        )
        if before is not None:
            feed.former.extend((*before.former, before.instance))
            before.is_forgotten = True
        latest = self._latest.values()
        for kept in self._store:
            if not kept.owed or report.ground in kept.owed or kept in latest:
                feed.offer(kept)
        self._feeds[report.ground] = feed
        thread = threading.Thread(
            target=self._send, args=(feed,), name=f'link {len(self._threads)}', daemon=True
        )
        self._threads.append(thread)
        thread.start()
        return feed

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
