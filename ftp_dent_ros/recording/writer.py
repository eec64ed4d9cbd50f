"""Writing bags: a queue that never holds up who receives, and files that survive `kill -9`.

The files are written by the library `mcap`; what a call has written is whole chunks in the
kernel's hands.
"""

from __future__ import annotations

import os
import threading
import time
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from ftp_dent_ros import __version__
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.files import write_atomically
from ftp_dent_ros.recording.topic import Message, RecordedTopic, qos_to_list

METADATA_FILE = 'metadata.yaml'
# rosbag2 gives a bag without messages this starting time.
NO_TIME_NS = 2**63 - 1
# A chunk is small enough for readers to hold many.
_CHUNK = 1 << 20


class BagWriter(AbstractContextManager['BagWriter']):
    """Writes a new bag: ``FOLDER/FOLDER_0.mcap``, at last ``FOLDER/metadata.yaml``.

    The file is of profile ``ros2``, uncompressed, with checksums and an index. Every message that
    `write` has returned from is in the kernel's hands: it outlives this process, and
    ``ftp-dent recover`` gives it back if the bag is never closed.

    Parameters
    ----------
    folder : Path
        Is made, and must not exist.

    Attributes
    ----------
    message_counts : dict of str to int
        Messages written, by topic.
    size : int
        Bytes of the file.

    Raises
    ------
    BagError
        The folder exists or cannot be made. By all that writes: the disk is full or fails; the
        bag then ends there.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.size = folder, 0
        self.message_counts: dict[str, int] = defaultdict(int)
        self._path = folder / f'{folder.resolve().name}_0.mcap'
        self._topics: dict[str, RecordedTopic] = {}
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._start_ns, self._end_ns = NO_TIME_NS, 0
        with self._disk():
            try:
                folder.mkdir(parents=True)
            except FileExistsError:
                raise BagError(
                    f'{folder}: exists already and is not overwritten: choose another output '
                    'folder'
                ) from None
            self._stream = self._path.open('xb')
            # Without a limit of its own it ends a chunk at a `flush` alone.
            self._writer = Writer(
                self._stream, chunk_size=1 << 62, compression=CompressionType.NONE
            )
            self._writer.start('ros2', f'ftp_dent_ros {__version__}')
            self._writer.flush()

    @property
    def topics(self) -> tuple[RecordedTopic, ...]:
        """Those made known so far."""
        return tuple(self._topics.values())

    @property
    def message_count(self) -> int:
        """Messages written."""
        return sum(list(self.message_counts.values()))

    def add_topic(self, topic: RecordedTopic) -> None:
        """Make a topic known before its first message; a second time changes nothing."""
        self._topics.setdefault(topic.name, topic)

    def write(self, messages: Iterable[Message]) -> None:
        """Write messages of known topics; when it returns, the kernel has them."""
        batch: list[Message] = []
        size = 0
        for message in messages:
            batch.append(message)
            size += len(message.data)
            if size >= _CHUNK:
                self._write(batch)
                batch, size = [], 0
        if batch:
            self._write(batch)

    def sync(self) -> None:
        """Have what is written outlive a power cut too; takes as long as the disk needs."""
        with self._disk():
            os.fdatasync(self._stream.fileno())

    def close(self) -> None:
        """Close the file and write ``metadata.yaml``: the bag is whole."""
        with self._disk():
            for topic in self.topics:
                self._channel(topic)
            information = self._information()
            self._writer.add_metadata('rosbag2', {'serialized_metadata': _yaml(information)})
            self._writer.finish()
            self._stream.flush()
            self.size = self._stream.tell()
            self.sync()
            self._stream.close()
            with write_atomically(self.folder / METADATA_FILE) as path:
                content = _yaml({'rosbag2_bagfile_information': information})
                path.write_text(content, encoding='utf-8')

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            with suppress(OSError):  # of a full disk
                self._stream.close()

    def _write(self, messages: list[Message]) -> None:
        """Write messages as one chunk."""
        with self._disk():
            for message in messages:
                self._writer.add_message(
                    self._channel(self._topics[message.topic]),
                    log_time=message.log_time_ns,
                    data=message.data,
                    publish_time=message.publish_time_ns,
                    sequence=message.sequence,
                )
            self._writer.flush()
            self.size = self._stream.tell()
        for message in messages:
            self.message_counts[message.topic] += 1
            self._start_ns = min(self._start_ns, message.log_time_ns)
            self._end_ns = max(self._end_ns, message.log_time_ns)

    def _channel(self, topic: RecordedTopic) -> int:
        if topic.type not in self._schemas:
            self._schemas[topic.type] = self._writer.register_schema(
                topic.type, 'ros2msg' if topic.definition else '', topic.definition.encode()
            )
        if topic.name not in self._channels:
            metadata = {
                'offered_qos_profiles': _yaml(qos_to_list(topic.offered_qos)).strip(),
                'topic_type_hash': topic.type_hash,
            }
            self._channels[topic.name] = self._writer.register_channel(
                topic.name, 'cdr', self._schemas[topic.type], metadata
            )
        return self._channels[topic.name]

    def _information(self) -> dict[str, Any]:
        """Content of ``rosbag2_bagfile_information``, version 9 (ROS 2 Jazzy)."""
        times = {
            'starting_time': {'nanoseconds_since_epoch': self._start_ns},
            'duration': {'nanoseconds': max(0, self._end_ns - self._start_ns)},
            'message_count': self.message_count,
        }
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            **times,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.type,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': qos_to_list(topic.offered_qos),
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': self.message_counts[topic.name],
                }
                for topic in self.topics
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self._path.name],
            'files': [{'path': self._path.name, **times}],
            'custom_data': None,
            # Where no ROS is sourced it is that of the wheels.
            'ros_distro': os.environ.get('ROS_DISTRO') or 'jazzy',
        }

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Tell of a disk that is full or fails."""
        try:
            yield
        except OSError as reason:
            raise BagError(
                f'{self.folder}: cannot be written ({reason.strerror}): free some space, or take '
                'another disk'
            ) from None


class BagSpool:
    """Hands messages to a `BagWriter` in a thread of its own.

    No publisher waits for the disk: what comes while the thread writes waits in memory, up to
    `capacity` bytes, and what comes when that is full is dropped and counted. Every two seconds
    the disk itself is brought up to date, for a drone's battery may be pulled after landing.

    Parameters
    ----------
    writer : BagWriter
        Written and closed by the thread alone.
    capacity : int
        Bytes of messages that may wait.

    Attributes
    ----------
    writer : BagWriter
    dropped : int
        Messages that were not taken because the queue was full.
    error : Exception or None
        Why the thread has stopped writing, or the bag could not be closed: a BagError if the
        disk is the reason. Messages are then no longer taken.
    """

    def __init__(self, writer: BagWriter, capacity: int) -> None:
        self.dropped = 0
        self.error: Exception | None = None
        self.writer, self._capacity = writer, capacity
        self._waiting: deque[Message] = deque()
        self._waiting_size = 0
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='bag writer', daemon=True)
        self._thread.start()

    def put(self, message: Message) -> None:
        """Queue a message, or drop it."""
        with self._lock:
            # A message larger than the whole queue is taken when it comes alone.
            full = self._waiting_size and self._waiting_size + len(message.data) > self._capacity
            if full or self.error is not None:
                self.dropped += 1
            else:
                self._waiting.append(message)
                self._waiting_size += len(message.data)

    def close(self) -> None:
        """Write what waits, close the bag and end the thread."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        """Write what waits, in a few chunks a second: few enough for an index of hours."""
        synced = time.monotonic()
        batch: deque[Message] = deque()
        before, is_last = 0, False
        try:
            while not is_last:
                is_last = self._closing.wait(0.1)
                before, batch = self.writer.message_count, self._waiting
                with self._lock:
                    self._waiting = deque()
                self.writer.write(batch)
                with self._lock:
                    self._waiting_size -= sum(len(message.data) for message in batch)
                if time.monotonic() - synced > 2.0:
                    self.writer.sync()
                    synced = time.monotonic()
            self.writer.close()
        except Exception as error:
            with self._lock:
                self.error = error
                unwritten = len(batch) - (self.writer.message_count - before)
                self.dropped += unwritten + len(self._waiting)


class _Dumper(yaml.SafeDumper):
    """Writes equal profiles out each time, as rosbag2 does, instead of referring to the first."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _yaml(content: object) -> str:
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, width=1000)
