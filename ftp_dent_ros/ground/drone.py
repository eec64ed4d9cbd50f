"""The drone's end: keeps what the payload gives and feeds it to each ground that reports."""

from __future__ import annotations

import contextlib
import heapq
import itertools
import re
import secrets
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

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
    Piece,
    Report,
    deflate,
)
from ftp_dent_ros.ground.topics import TOPICS

_CROWD = 1000  # items in line before those that are gone are swept out
_POLL = 0.1  # seconds
_FILE = re.compile(r'([0-5])_(-?\d+)_(\d{1,19})\.item')


@dataclass(eq=False)
class StoredItem:
    """An item that is kept, in memory or on disk.

    Attributes
    ----------
    name : int
    importance : Importance
    stamp_ns : int
    size : int
        Bytes.
    topic : str
        '' for one that was found on disk.
    data : bytes or None
        The packed item; None if it is on disk, or gone.
    path : Path or None
        Its file.
    latest : bool
        Whether it is the newest of a latched topic.
    order : int
        Its place in line among those of its importance.
    owed : set of bytes
        Grounds that it is promised to and that have not got it.
    begun, gone : bool
        Whether some of it has been sent, and whether it is kept no longer.
    """

    name: int
    importance: Importance
    stamp_ns: int
    size: int
    topic: str = ''
    data: bytes | None = None
    path: Path | None = None
    latest: bool = False
    order: int = 0
    owed: set[bytes] = field(default_factory=set)
    begun: bool = False
    gone: bool = False

    def __post_init__(self) -> None:
        """Of what is replaced topics take turns, or those with the newest stamps would be all."""
        self.order = self.name if self.importance in REPLACED else -self.stamp_ns


class Store:
    """Items by name, the least important and oldest dropped when there is no room.

    State, previews and lists are kept in memory alone: another start has newer ones.

    Parameters
    ----------
    folder : Path or None
        Made if it is not there; None keeps all in memory.
    limit : int
        Bytes of all items.

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

    def __init__(self, folder: Path | None, limit: int) -> None:
        self.dropped = self.unwritten = self.size = 0
        self._folder, self._limit = folder, limit
        # From where no other start began to count.
        self._names = itertools.count(secrets.randbits(62))
        self._kept: dict[int, StoredItem] = {}
        # By topic, of those whose next takes their place.
        self._newest: dict[str, StoredItem] = {}
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
            match, size = _FILE.fullmatch(path.name), path.stat().st_size
            if match and size <= LARGEST_ITEM:
                importance, stamp_ns, name = map(int, match.groups())
                kept = StoredItem(name, Importance(importance), stamp_ns, size, path=path)
                self._kept[name] = kept
                self.size += size

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[StoredItem]:
        with self._lock:
            return iter(list(self._kept.values()))

    def put(self, item: Item) -> StoredItem:
        """Keep an item, and drop what it takes the place of."""
        data, name = item.pack(), next(self._names)
        kept = StoredItem(
            name, item.importance, item.stamp_ns, len(data), item.topic, data, None, item.latest
        )
        with self._lock:
            if item.latest or item.importance in REPLACED:
                self._replace(kept)
            elif self._folder is not None:
                self._write(kept, data)
            self._kept[name] = kept
            self.size += kept.size
            while self.size > self._limit and len(self._kept) > 1:
                # The least important, of these the oldest.
                self.remove(max(self._kept.values(), key=lambda k: (k.importance, -k.stamp_ns)))
                self.dropped += 1
        return kept

    def read(self, kept: StoredItem) -> bytes | None:
        """Bytes of an item, or None if it is no longer there."""
        with self._lock:
            if kept.path is None or kept.gone:
                return kept.data
            try:
                data = kept.path.read_bytes()
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
            self.size -= kept.size
            kept.gone, kept.data = True, None
            if kept.path is not None:
                with contextlib.suppress(OSError):
                    kept.path.unlink(missing_ok=True)

    def waiting(self, importance: Importance) -> int:
        """How many items of an importance are kept."""
        return sum(kept.importance == importance for kept in self)

    def _replace(self, kept: StoredItem) -> None:
        """Put an item in the place of its topic's last one, unless that is on its way."""
        other, self._newest[kept.topic] = self._newest.get(kept.topic), kept
        if other is None:
            return
        other.latest = False
        if not other.begun:
            kept.order = min(kept.order, other.order)
        if not (other.begun and other.owed):
            self.remove(other)

    def _write(self, kept: StoredItem, data: bytes) -> None:
        """Write an item; if the disk is full it stays in memory as long as there is room."""
        assert self._folder is not None
        path = self._folder / f'{int(kept.importance)}_{kept.stamp_ns}_{kept.name}.item'
        try:
            path.write_bytes(data)
            kept.data, kept.path = None, path
        except OSError:
            self.unwritten += 1
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


@dataclass
class _Progress:
    """How far an item is sent: what is still to be sent of its bytes as they cross the air."""

    kept: StoredItem
    whole: bytes
    data: bytes
    gaps: list[tuple[int, int]]
    acknowledged: int = 0


class _InFlight(NamedTuple):
    sequence: int
    progress: _Progress
    offset: int
    mark: SentMark


class Feed:
    """One ground's share of the store, a piece at a time; not for several threads at once.

    Parameters
    ----------
    ground : bytes
    instance : int
        Of the ground's program.
    store : Store
    limit : float
        byte/s that must never be exceeded; 0 for none.
    now : callable
        Monotonic time, seconds.
    """

    def __init__(
        self,
        ground: bytes,
        instance: int,
        store: Store,
        limit: float = 0.0,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.ground, self.instance = ground, instance
        #: Names this feed in its pieces.
        self.link = secrets.randbits(32)
        # Starts of the ground's program before this one.
        self.former: deque[int] = deque(maxlen=8)
        self.pace = Pace(limit, now)
        self.lost = self.sent_pieces = 0
        self._store, self._now = store, now
        self._heard = self._last_news = now()
        self._trials = 0
        self._in_flight: deque[_InFlight] = deque()
        self._waiting: list[tuple[int, int, int, StoredItem]] = []
        self._progress: dict[int, _Progress] = {}
        # When each topic's last item was begun, and how many bytes cross the air of it.
        self._begun: dict[str, tuple[float, int]] = {}
        # Name and bytes of the last item of each topic that the ground has.
        self._references: dict[str, tuple[int, bytes]] = {}

    @property
    def silence(self) -> float:
        """Seconds since the last report."""
        return self._now() - self._heard

    @property
    def _bytes_in_flight(self) -> int:
        return sum(each.mark.size for each in self._in_flight)

    def offer(self, kept: StoredItem) -> None:
        """An item is to be sent here."""
        kept.owed.add(self.ground)
        heapq.heappush(self._waiting, (int(kept.importance), kept.order, kept.name, kept))
        if len(self._waiting) > 2 * len(self._store) + _CROWD:
            # What was replaced meanwhile must not pile up in a long silence.
            self._waiting = [entry for entry in self._waiting if not entry[-1].gone]
            heapq.heapify(self._waiting)

    def is_due(self, topic: str) -> bool:
        """Whether the next of a topic may be sent, for the share of the link that it may take.

        By the rate as it is known now: in the beginning it is known to be far too low.
        """
        bound = TOPICS.get(topic)
        if bound is None or not bound.share or topic not in self._begun:
            return True
        at, size = self._begun[topic]
        return self._now() >= at + max(bound.period, size / (bound.share * self.pace.rate))

    def next_piece(self) -> Piece | None:
        """Piece to send now, if there is one and the link takes it."""
        self._lose_if_old()
        pace, size = self.pace, self.pace.piece
        is_open = not self._in_flight or self._bytes_in_flight + size <= pace.window
        if not is_open or len(self._in_flight) >= WINDOW or pace.wait or self.silence > SILENCE:
            return None
        progress = self._choose()
        if progress is None:
            return None
        start, end = progress.gaps[0]
        size = min(size, end - start)
        data, self.sent_pieces = progress.data, self.sent_pieces + 1
        progress.gaps[:1] = [(start + size, end)] if start + size < end else []
        waits = (not kept.gone and self.is_due(kept.topic) for *_, kept in self._waiting)
        is_full = any(each.gaps for each in self._progress.values()) or any(waits)
        if not self._in_flight:
            self._last_news = self._now()
        mark = pace.sent(size, not self._in_flight, is_full)
        self._in_flight.append(_InFlight(self.sent_pieces, progress, start, mark))
        part = data[start : start + size]
        return Piece(progress.kept.name, self.link, self.sent_pieces, len(data), start, part)

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
                self.pace.acknowledged(flight.mark)
                done += self._arrived(flight)
            elif age >= WINDOW or (age > 0 and now > flight.mark.sent_at + overdue):
                self._send_again(flight)
            else:  # a later piece may have overtaken it
                self._in_flight.append(flight)
        return done

    def _arrived(self, flight: _InFlight) -> list[StoredItem]:
        """Each byte is in a gap, in flight or acknowledged: the last one makes its item whole."""
        progress, kept = flight.progress, flight.progress.kept
        progress.acknowledged += flight.mark.size
        if progress.acknowledged < len(progress.data):
            return []
        del self._progress[kept.name]
        if kept.topic and len(progress.whole) <= LARGEST_REFERENCE:
            self._references[kept.topic] = kept.name, progress.whole
        kept.owed.discard(self.ground)
        return [kept]

    def _send_again(self, flight: _InFlight) -> None:
        self.lost += 1
        flight.progress.gaps.insert(0, (flight.offset, flight.offset + flight.mark.size))

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
        early = []
        while self._waiting and (first is None or self._waiting[0][0] < first.kept.importance):
            entry = heapq.heappop(self._waiting)
            kept = entry[-1]
            if not kept.gone and not self.is_due(kept.topic):
                early.append(entry)
            elif (data := self._store.read(kept)) is not None:
                first = self._begin(kept, data)
        for entry in early:
            heapq.heappush(self._waiting, entry)
        return first

    def _begin(self, kept: StoredItem, data: bytes) -> _Progress:
        kept.begun = True
        if kept.importance > Importance.PREVIEWS:  # compressed in its own format
            sent = deflate(data, level=0)
        else:
            sent = deflate(data, *self._references.get(kept.topic, (0, b'')))
        self._begun[kept.topic] = self._now(), len(sent)
        progress = _Progress(kept, data, sent, [(0, len(sent))])
        self._progress[kept.name] = progress
        return progress


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
        self._link, self._limit = link, limit
        self._store = Store(folder, room)
        self._feeds: dict[bytes, Feed] = {}
        self._changed = threading.Condition()
        self._stop = False
        self._threads: list[threading.Thread] = []
        link.on('up', self._take)
        link.answer(CHANNEL, executive.reply)

    def put(self, item: Item) -> None:
        """Send an item to all grounds, now or later; never waits for a link."""
        kept = self._store.put(item)
        with self._changed:
            self._forget_grounds()
            for feed in self._feeds.values():
                feed.offer(kept)
            self._changed.notify_all()

    def is_due(self, topic: str) -> bool:
        """Whether a ground that is heard may be sent the next of a topic."""
        return any(feed.is_due(topic) for feed in self._heard())

    def state(self) -> dict[str, str]:
        """What there is to say about the link, by name."""
        with self._changed:
            feeds, heard = list(self._feeds.values()), self._heard()
            sent, lost = (sum(getattr(f, of) for f in feeds) for of in ('sent_pieces', 'lost'))
            return {
                'grounds': str(len(heard)),
                'grounds out of reach': str(len(feeds) - len(heard)),
                'rate (kbit/s)': f'{8e-3 * min((f.pace.rate for f in heard), default=0.0):.0f}',
                'round trip (ms)': f'{1e3 * max((f.pace.trip for f in heard), default=0.0):.0f}',
                'pieces sent': str(sent),
                'pieces sent again (%)': f'{100 * lost / max(sent, 1):.1f}',
                **{f'waiting: {e.name.lower()}': str(self._store.waiting(e)) for e in Importance},
                'waiting (MB)': f'{self._store.size / 1e6:.1f}',
                'dropped for want of room': str(self._store.dropped),
                'not on disk (it is full)': str(self._store.unwritten),
                'refused': str(self.refused),
            }

    def _heard(self) -> list[Feed]:
        with self._changed:
            return [feed for feed in self._feeds.values() if feed.silence < SILENCE]

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
                self._forget_grounds()
                if feed is None and len(self._feeds) >= 8:
                    self.refused += 1
                    return
                feed = self._new_feed(report, feed)
            for kept in feed.take(report):
                # A list is kept for those who come later.
                if not kept.owed and not kept.latest:
                    self._store.remove(kept)
            self._changed.notify_all()

    def _new_feed(self, report: Report, before: Feed | None) -> Feed:
        """Feed of a ground, or of one that was started anew: what it had in part is lost."""
        feed = Feed(report.ground, report.instance, self._store, self._limit)
        if before is not None:
            feed.former.extend((*before.former, before.instance))
        for kept in self._store:
            if not kept.owed or report.ground in kept.owed or kept.latest:
                feed.offer(kept)
        self._feeds[report.ground] = feed
        name = f'link {len(self._threads)}'
        thread = threading.Thread(target=self._send, args=(feed,), name=name, daemon=True)
        self._threads.append(thread)
        thread.start()
        return feed

    def _forget_grounds(self) -> None:
        """What a ground is owed that has been silent for an hour goes to the next."""
        for ground, feed in list(self._feeds.items()):
            if feed.silence > 3600:
                del self._feeds[ground]
                for kept in self._store:
                    kept.owed.discard(ground)

    def _send(self, feed: Feed) -> None:
        """Send what is next, in the feed's thread: it may wait for its connection, no other."""
        channel = f'down/{feed.ground.hex()}'
        while True:
            with self._changed:
                if self._stop or self._feeds.get(feed.ground) is not feed:
                    return
                piece = feed.next_piece()
                if piece is None:
                    self._changed.wait(min(feed.pace.wait or _POLL, _POLL))
                    continue
            self._link.send(channel, piece.pack())
