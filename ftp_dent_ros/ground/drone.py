"""The drone's end: keeps what the payload gives and feeds it to each ground that reports."""

from __future__ import annotations

import secrets
import threading
import time
from pathlib import Path

from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground.commands import WAY, Executive
from ftp_dent_ros.ground.feed import SILENCE, Feed
from ftp_dent_ros.ground.frames import Report
from ftp_dent_ros.ground.item import Importance, Item
from ftp_dent_ros.ground.link import Link
from ftp_dent_ros.ground.pace import Pace
from ftp_dent_ros.ground.store import Kept, Store

# Grounds served at once; more are refused.
_MOST_GROUNDS = 8
# A ground that is silent for so long (s) is forgotten, and what it is owed goes to the next.
_FORGOTTEN = 3600.0
_POLL = 0.1


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
        link.answer(WAY, executive.reply)

    def put(self, item: Item) -> None:
        """Send an item to all grounds, now or later; never waits for a link."""
        kept = self._store.put(item)
        with self._changed:
            if item.latest:
                before = self._latest.get(item.topic)
                if before is not None and not before.owed:
                    self._store.remove(before)
                self._latest[item.topic] = kept
            for ground, feed in list(self._feeds.items()):
                if feed.silence > _FORGOTTEN:
                    self._give_up(ground)
                else:
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
        for ground, feed in list(self._feeds.items()):
            if feed.silence > _FORGOTTEN:
                self._give_up(ground)
        if len(self._feeds) >= _MOST_GROUNDS:
            return None
        feed = Feed(
            report.ground, report.instance, secrets.randbits(32), self._store, Pace(self._limit)
        )
        for kept in self._store:
            if not kept.claimed:
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

    def _give_up(self, ground: bytes) -> None:
        feed = self._feeds.pop(ground)
        for kept in self._store:
            kept.owed.discard(ground)
            if not kept.owed:
                kept.claimed = False
        feed.instance = -1

    def _send(self, feed: Feed) -> None:
        """Send what is next, in the feed's thread: it may wait for its connection, no other."""
        way = f'down/{feed.ground.hex()}'
        while True:
            with self._changed:
                if self._stop or feed.instance < 0:
                    return
                found = feed.next_piece()
                if found is None:
                    self._changed.wait(_POLL)
                    continue
            piece, wait = found
            if wait > 0:
                time.sleep(min(wait, _POLL))
                continue
            self._link.send(way, piece.pack())
