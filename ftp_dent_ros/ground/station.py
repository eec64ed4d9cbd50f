"""The ground's end: puts together what comes, and reports what has come."""

from __future__ import annotations

import contextlib
import hashlib
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from itertools import chain

from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground.commands import Answer, give_command
from ftp_dent_ros.ground.link import GroundLink
from ftp_dent_ros.ground.protocol import (
    LARGEST_REFERENCE,
    REPLACED,
    SILENCE,
    WINDOW,
    Item,
    Piece,
    Report,
    inflate,
    remember,
)

# Seconds that the rate is a mean of.
_WINDOW = 10.0


class _Part:
    """What has come of an item, and where bytes are missing: pieces may overlap."""

    def __init__(self, size: int) -> None:
        self.data, self.missing, self.left = bytearray(size), bytearray(b'\1' * size), size

    def take(self, piece: Piece) -> bool:
        """Take a piece; whether it has anything new."""
        end = piece.offset + len(piece.data)
        new = self.missing.count(1, piece.offset, end)
        self.data[piece.offset : end] = piece.data
        self.missing[piece.offset : end] = bytes(len(piece.data))
        self.left -= new
        return new > 0


class Assembly:
    """Puts items together and says what has come.

    Its memory is bounded: a drone, or whoever speaks in its name, may send anything.

    Parameters
    ----------
    ground : bytes
        16 bytes that name this ground.
    instance : int
        Of this program.
    """

    def __init__(self, ground: bytes, instance: int) -> None:
        self.repeated = self.bytes = 0
        self._ground, self._instance = ground, instance
        self._parts: dict[int, _Part] = {}
        self._held = 0
        self._done: dict[int, None] = {}
        # The last items of each topic, from which later ones may differ: more than can be in
        # flight when the drone learns of the one that it has chosen.
        self._recent: dict[str, deque[tuple[int, bytes]]] = {}
        # Names of the last items of which only the newest is of use; the drone counts upwards.
        self._newest: dict[str, int] = {}
        self._link = self._sequence = self._received = 0

    def add(self, piece: Piece) -> Item | None:
        """Take a piece; the item that it makes whole, once.

        Raises
        ------
        CodecError
            The item's checksum is wrong, its pieces do not fit, or what it differs from is not
            here.
        """
        self._note(piece)
        self.bytes += len(piece.data)
        part = None if piece.name in self._done else self._part(piece)
        if part is None or not part.take(piece):
            self.repeated += 1
        if part is None or part.left:
            return None
        self._drop(piece.name)
        remember(self._done, piece.name, None, 100_000)
        return self._item(piece.name, bytes(part.data))

    def report(self) -> Report:
        """What has come so far."""
        return Report(self._ground, self._instance, self._sequence, self._link, self._received)

    @property
    def unfinished(self) -> int:
        """Items of which some pieces have come."""
        return len(self._parts)

    def _item(self, name: int, sent: bytes) -> Item | None:
        """What was sent; None if a newer one has overtaken it in whose place it would come."""
        whole = inflate(sent, dict(chain.from_iterable(self._recent.values())).get)
        item = Item.unpack(whole)
        if len(whole) <= LARGEST_REFERENCE:
            recent = self._recent.get(item.topic) or deque(maxlen=WINDOW)
            recent.append((name, whole))
            remember(self._recent, item.topic, recent, 24)
        if item.latest or item.importance in REPLACED:
            if name < self._newest.get(item.topic, 0):
                return None
            remember(self._newest, item.topic, name, 24)
        return item

    def _note(self, piece: Piece) -> None:
        if piece.link != self._link:
            self._link, self._sequence, self._received = piece.link, piece.sequence, 1
            self._newest.clear()
            return
        ahead = piece.sequence - self._sequence
        if ahead > 0:
            self._received = (self._received << min(ahead, WINDOW) | 1) & ((1 << WINDOW) - 1)
            self._sequence = piece.sequence
        elif -ahead < WINDOW:
            self._received |= 1 << -ahead

    def _part(self, piece: Piece) -> _Part:
        part = self._parts.get(piece.name)
        if part is not None and len(part.data) != piece.total:
            self._drop(piece.name)
            raise CodecError('pieces of one item disagree on its size: they are refused')
        if part is None:
            while self._parts and (self._held + piece.total > 64 << 20 or len(self._parts) >= 64):
                self._drop(next(iter(self._parts)))
            part = self._parts[piece.name] = _Part(piece.total)
            self._held += piece.total
        return part

    def _drop(self, name: int) -> None:
        self._held -= len(self._parts.pop(name).data)


class Station:
    """Receives items over a link.

    Parameters
    ----------
    link : GroundLink
    take : callable
        Called with each item, once, in a thread of the link's.
    name : str
        Of this ground, other than any other ground's of the same drone; the machine's and its
        purpose's by default. After a restart it must be the same, so that nothing comes twice.
    """

    def __init__(self, link: GroundLink, take: Callable[[Item], None], name: str = '') -> None:
        self.refused = self.items = 0
        self._reported: int | None = None
        self._link = link
        self._hand_over = take
        ground = hashlib.sha256((name or socket.gethostname()).encode()).digest()[:16]
        self._assembly = Assembly(ground, secrets.randbits(31))
        self._lock = threading.Lock()
        self._came: deque[tuple[float, int]] = deque(maxlen=50_000)
        self._heard = float('-inf')
        self._stop = threading.Event()
        self._due = threading.Event()
        link.on(f'down/{ground.hex()}', self._take)
        self._thread = threading.Thread(target=self._report, name='reports', daemon=True)
        self._thread.start()

    def rate(self) -> float:
        """byte/s that came in the last ten seconds."""
        since = time.monotonic() - _WINDOW
        with self._lock:
            return sum(size for at, size in self._came if at >= since) / _WINDOW

    def summary(self) -> tuple[int, str]:
        """Level of the link (0 works, 1 warns) and a sentence."""
        silence = time.monotonic() - self._heard
        if silence == float('inf'):
            return 1, (
                'nothing has come from the drone yet: if it stays so, see whether the address is '
                "the drone's, a downlink runs there, and the keys of both ends were made together"
            )
        if silence > SILENCE:
            return 1, f'nothing has come from the drone for {silence:.0f} s'
        return 0, 'the link to the drone works'

    def change(self) -> str:
        """Sentence on the link, once when it works or no longer does; else nothing."""
        level, text = self.summary()
        if level == self._reported:
            return ''
        self._reported = level
        return text

    def state(self) -> dict[str, str]:
        """What there is to say about the link, by name."""
        return {
            'received (kbit/s)': f'{8e-3 * self.rate():.0f}',
            'items': str(self.items),
            'unfinished items': str(self._assembly.unfinished),
            'pieces that came again': str(self._assembly.repeated),
            'refused': str(self.refused),
        }

    def command(self, name: str) -> Answer:
        """Give the drone a command, and wait for what becomes of it."""
        return give_command(self._link, name)

    def close(self) -> None:
        """Stop reporting and end the connection."""
        self._stop.set()
        self._due.set()
        self._thread.join()
        self._link.close()

    def _take(self, data: bytes) -> None:
        item = None
        with self._lock:
            try:
                item = self._assembly.add(Piece.unpack(data))
            except CodecError:
                self.refused += 1
                return
            self._heard = time.monotonic()
            self._came.append((self._heard, len(data)))
        self._due.set()
        if item is not None:
            self.items += 1
            self._hand_over(item)

    def _report(self) -> None:
        """Report after each piece, or after several that come at once; in a thread of its own.

        The last one is sent at the end: what came before it need not come again.
        """
        is_last = False
        while not is_last:
            # The drone takes three seconds of silence for an outage.
            self._due.wait(0.7)
            self._due.clear()
            is_last = self._stop.wait(0.005)
            with self._lock:
                report = self._assembly.report()
            with contextlib.suppress(Exception):  # a connection that is being made anew
                self._link.send('up', report.pack())
