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

from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground.assembly import Assembly
from ftp_dent_ros.ground.commands import Answer, command
from ftp_dent_ros.ground.frames import Piece
from ftp_dent_ros.ground.item import Item
from ftp_dent_ros.ground.link import Link

# Seconds between reports while nothing comes (the drone takes three of silence for an outage), and
# while pieces do.
_IDLE, _PAUSE = 0.7, 0.005
_WINDOW = 10.0
# Without anything from the drone for so long (s) the link is told as lost.
_SILENCE = 3.0


class Station:
    """Receives items over a link.

    Parameters
    ----------
    link : Link
    take : callable
        Called with each item, once, in a thread of the link's.
    name : str
        Of this ground, other than any other ground's of the same drone; the machine's and its
        purpose's by default. After a restart it must be the same, so that nothing comes twice.
    """

    def __init__(self, link: Link, take: Callable[[Item], None], name: str = '') -> None:
        self.refused = self.items = 0
        self._told: int | None = None
        self._link = link
        self._hand_over = take
        ground = hashlib.sha256((name or socket.gethostname()).encode()).digest()[:16]
        self._assembly = Assembly(ground, secrets.randbits(31))
        self._lock = threading.Lock()
        self._came: deque[tuple[float, int]] = deque()
        self._heard = float('-inf')
        self._stop = threading.Event()
        self._due = threading.Event()
        link.on(f'down/{ground.hex()}', self._take)
        self._thread = threading.Thread(target=self._report, name='reports', daemon=True)
        self._thread.start()

    @property
    def silence(self) -> float:
        """Seconds since anything came; infinite if nothing ever did."""
        return time.monotonic() - self._heard

    def rate(self) -> float:
        """byte/s that came in the last ten seconds."""
        with self._lock:
            now = time.monotonic()
            while self._came and self._came[0][0] < now - _WINDOW:
                self._came.popleft()
            return sum(size for _, size in self._came) / _WINDOW

    def summary(self) -> tuple[int, str]:
        """Level of the link (0 works, 1 warns) and a sentence."""
        if self.silence == float('inf'):
            return 1, (
                'nothing has come from the drone yet: if it stays so, see whether the address is '
                "the drone's, a downlink runs there, and the keys of both ends were made together"
            )
        if self.silence > _SILENCE:
            return 1, f'nothing has come from the drone for {self.silence:.0f} s'
        return 0, 'the link to the drone works'

    def change(self) -> str:
        """What to tell of the link, once when it works or no longer does; else nothing."""
        level, text = self.summary()
        if level == self._told:
            return ''
        self._told = level
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
        return command(self._link, name)

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
            self._due.wait(_IDLE)
            self._due.clear()
            is_last = self._stop.wait(_PAUSE)
            with self._lock:
                report = self._assembly.report()
            with contextlib.suppress(Exception):  # a connection that is being made anew
                self._link.send('up', report.pack())
