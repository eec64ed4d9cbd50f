"""The queue between who receives messages and who writes them, and the thread that writes.

Its promise: no publisher waits for a disk, and what is lost when one is too slow is counted.
"""

from __future__ import annotations

import threading
import time
from collections import deque

from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagWriter

# A drone's battery may be pulled as soon as it has landed.
SYNC_PERIOD_S = 2.0


class Spool:
    """Hands messages to a `BagWriter` in a thread of its own, as soon as they come.

    Whoever receives is never held up by the disk: what comes while the thread writes waits in
    memory, up to `capacity` bytes, and what comes when that is full is dropped and counted. Every
    two seconds the disk itself is brought up to date.

    Parameters
    ----------
    writer : BagWriter
        Written by the thread alone until `close`.
    capacity : int
        Bytes of messages that may wait.

    Attributes
    ----------
    dropped : int
        Messages that were not taken because the queue was full.
    error : Exception or None
        Why the thread has stopped writing, a BagError if the disk is the reason. Messages are
        then no longer taken.
    """

    def __init__(self, writer: BagWriter, capacity: int) -> None:
        self.dropped = 0
        self.error: Exception | None = None
        self._writer = writer
        self._capacity = capacity
        self._waiting: deque[Message] = deque()
        self._waiting_size = 0
        self._closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name='bag writer', daemon=True)
        self._thread.start()

    def put(self, message: Message) -> bool:
        """Queue a message; False if it was dropped."""
        with self._changed:
            # A message larger than the whole queue is taken when it comes alone.
            full = self._waiting_size and self._waiting_size + len(message.data) > self._capacity
            if full or self.error is not None:
                self.dropped += 1
                return False
            self._waiting.append(message)
            self._waiting_size += len(message.data)
            self._changed.notify()
            return True

    def close(self) -> None:
        """Write what waits and end the thread; the writer is left open."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        synced = time.monotonic()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing)
                if not self._waiting:
                    return
                batch, self._waiting = self._waiting, deque()
            before = self._writer.message_count
            try:
                self._writer.write(batch)
                if time.monotonic() - synced > SYNC_PERIOD_S:
                    self._writer.sync()
                    synced = time.monotonic()
            except Exception as error:
                with self._changed:
                    self.error = error
                    written = self._writer.message_count - before
                    self.dropped += len(batch) - written + len(self._waiting)
                    return
            with self._changed:
                self._waiting_size -= sum(len(message.data) for message in batch)
