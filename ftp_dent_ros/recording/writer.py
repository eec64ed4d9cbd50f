"""Writing bags: a queue that never holds up who receives, and files that survive `kill -9`.

The records are those of the library `mcap`. Its own writer keeps messages in memory until a chunk
is full, so that a killed recorder loses them. Here each call writes a whole chunk.
"""

from __future__ import annotations

import errno
import os
import threading
import time
import zlib
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.records import Message as MessageRecord

from ftp_dent_ros import __version__
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.recording.topic import Message, RecordedTopic, qos_to_list

MAGIC = b'\x89MCAP0\r\n'
METADATA_FILE = 'metadata.yaml'
# rosbag2 gives a bag without messages this starting time.
NO_TIME_NS = 2**63 - 1


@dataclass(frozen=True)
class BagFile:
    """One file of a bag: its name in the bag's folder, and its part of the time."""

    path: str
    start_ns: int
    duration_ns: int
    message_count: int


@dataclass(frozen=True)
class BagMetadata:
    """What a bag says about itself.

    A topic's name is there twice if messages of two types were recorded of it.
    """

    files: tuple[BagFile, ...]
    topics: tuple[RecordedTopic, ...]
    message_counts: Mapping[str, int]
    ros_distro: str = ''
    custom_data: Mapping[str, str] = field(default_factory=dict)

    @property
    def message_count(self) -> int:
        """Number of messages in all files."""
        return sum(file.message_count for file in self.files)

    @property
    def start_ns(self) -> int:
        """Log time of the first message, in ns since the epoch (`NO_TIME_NS` if none)."""
        return min((file.start_ns for file in self.files), default=NO_TIME_NS)

    @property
    def duration_ns(self) -> int:
        """Time from the first message to the last."""
        ends = [file.start_ns + file.duration_ns for file in self.files if file.message_count]
        return max(ends) - self.start_ns if ends else 0

    def to_mapping(self) -> dict[str, Any]:
        """Content of ``rosbag2_bagfile_information``, version 9 (ROS 2 Jazzy)."""
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            'duration': {'nanoseconds': self.duration_ns},
            'starting_time': {'nanoseconds_since_epoch': self.start_ns},
            'message_count': self.message_count,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.type,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': qos_to_list(topic.offered_qos),
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': self.message_counts.get(topic.name, 0),
                }
                for topic in self.topics
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [file.path for file in self.files],
            'files': [
                {
                    'path': file.path,
                    'starting_time': {'nanoseconds_since_epoch': file.start_ns},
                    'duration': {'nanoseconds': file.duration_ns},
                    'message_count': file.message_count,
                }
                for file in self.files
            ],
            'custom_data': dict(self.custom_data) or None,
            'ros_distro': self.ros_distro,
        }


class BagWriter:
    """Writes a new bag: ``FOLDER/NAME_0.mcap`` and so on, at last ``FOLDER/metadata.yaml``.

    Every message that `write` has returned from is in the kernel's hands: it outlives this
    process, and `recovery.recover` gives it back if the bag is never closed.

    Parameters
    ----------
    folder : Path
        Is made, and must not exist.
    name : str, optional
        What the files are called; the folder's name by default.
    max_file_size : int, optional
        Bytes after which the next file is begun; 0 for one file.

    Attributes
    ----------
    custom_data : dict of str to str
        Further entries of the metadata; may grow until the bag is closed.

    Raises
    ------
    BagError
        The folder exists or cannot be made. By `write` and `close`: the disk is full or fails.
    """

    def __init__(self, folder: Path, name: str = '', max_file_size: int = 0) -> None:
        self.folder = folder
        self.message_counts: dict[str, int] = defaultdict(int)
        self.custom_data: dict[str, str] = {}
        self._name = name or folder.resolve().name
        self._max_file_size = max_file_size
        self._topics: dict[str, RecordedTopic] = {}
        self._files: list[BagFile] = []
        self._closed_size = 0
        try:
            folder.mkdir(parents=True)
            self._file = self._next_file()
        except FileExistsError:
            raise BagError(
                f'{folder}: exists already and is not overwritten: choose another output folder'
            ) from None
        except OSError as reason:
            raise self._failure(reason) from None

    @property
    def topics(self) -> tuple[RecordedTopic, ...]:
        """Those made known so far."""
        return tuple(self._topics.values())

    @property
    def message_count(self) -> int:
        """Messages written."""
        return sum(list(self.message_counts.values()))

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return self._closed_size + self._file.size

    def add_topic(self, topic: RecordedTopic) -> None:
        """Make a topic known before its first message; a second time changes nothing."""
        self._topics.setdefault(topic.name, topic)

    def write(self, messages: Iterable[Message]) -> None:
        """Write messages of known topics; when it returns, the kernel has them."""
        batch: list[Message] = []
        # A chunk is small enough for readers to hold many.
        most = min(1 << 20, self._max_file_size or 1 << 20)
        for message in messages:
            batch.append(message)
            if sum(len(each.data) for each in batch) >= most:
                self._write(batch)
                batch = []
        self._write(batch)

    def sync(self) -> None:
        """Have what is written outlive a power cut too; takes as long as the disk needs."""
        try:
            self._file.sync()
        except OSError as reason:
            raise self._failure(reason) from None

    def split(self) -> None:
        """Close the file and begin the next one."""
        try:
            self._close_file()
            self._file = self._next_file()
        except OSError as reason:
            raise self._failure(reason) from None

    def close(self) -> BagMetadata:
        """Close the file and write ``metadata.yaml``: the bag is whole."""
        try:
            self._close_file()
            metadata = self._metadata(self._files)
            content = {'rosbag2_bagfile_information': metadata.to_mapping()}
            with written_aside(self.folder / METADATA_FILE) as path:
                path.write_text(_yaml(content), encoding='utf-8')
        except OSError as reason:
            raise self._failure(reason) from None
        return metadata

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._file.abandon()

    def _write(self, messages: list[Message]) -> None:
        if not messages:
            return
        try:
            self._file.write(messages, self._topics)
        except OSError as reason:
            raise self._failure(reason) from None
        for message in messages:
            self.message_counts[message.topic] += 1
        if 0 < self._max_file_size <= self._file.size:
            self.split()

    def _next_file(self) -> _McapFile:
        return _McapFile(self.folder / f'{self._name}_{len(self._files)}.mcap')

    def _close_file(self) -> None:
        described = self._file.description
        metadata = self._metadata([*self._files, described])
        self._file.close(self.topics, {'serialized_metadata': _yaml(metadata.to_mapping())})
        self._files.append(described)
        self._closed_size += self._file.size
        self._file.size = 0

    def _metadata(self, files: Sequence[BagFile]) -> BagMetadata:
        # Where no ROS is sourced it is that of the wheels.
        distro = os.environ.get('ROS_DISTRO') or 'jazzy'
        counts = dict(self.message_counts)
        return BagMetadata(tuple(files), self.topics, counts, distro, self.custom_data)

    def _failure(self, reason: OSError) -> BagError:
        if reason.errno in (errno.ENOSPC, errno.EDQUOT):
            what, advice = 'the disk is full', 'free some space'
        elif reason.errno == errno.EFBIG:
            what = 'the file has grown to the limit of its file system or user'
            advice = 'record smaller files with --max-bag-size'
        else:
            what, advice = f'cannot be written ({reason.strerror})', 'check the disk'
        return BagError(f'{self.folder}: {what}: {advice}')


class BagSpool:
    """Hands messages to a `BagWriter` in a thread of its own.

    No publisher waits for the disk: what comes while the thread writes waits in memory, up to
    `capacity` bytes, and what comes when that is full is dropped and counted. Every two seconds
    the disk itself is brought up to date, for a drone's battery may be pulled after landing.

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
        self._closing = threading.Event()
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
            self._closing.set()
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        synced = time.monotonic()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing.is_set())
                if not self._waiting:
                    return
                batch, self._waiting = self._waiting, deque()
            before = self._writer.message_count
            try:
                self._writer.write(batch)
                if time.monotonic() - synced > 2.0:
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
            # Ten chunks a second are few enough for an index of hours.
            self._closing.wait(0.1)


class _McapFile:
    """One new file in profile ``ros2``, uncompressed, with checksums and an index.

    OSError is raised by every method that writes; the file then ends with the last whole chunk.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self._stream = path.open('xb', buffering=0)
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[str, Channel] = {}
        self._new: list[McapRecord] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._start_ns = NO_TIME_NS
        self._end_ns = 0
        self._chunk_count = 0
        self._chunk_indexes = bytearray()  # records: objects would be some times as large
        self._append(MAGIC + _encoded(Header('ros2', f'ftp_dent_ros {__version__}')))

    @property
    def description(self) -> BagFile:
        """The file as it is now."""
        count = sum(self._counts.values())
        duration_ns = self._end_ns - self._start_ns if count else 0
        return BagFile(self.path.name, self._start_ns, duration_ns, count)

    def write(self, messages: Sequence[Message], topics: Mapping[str, RecordedTopic]) -> None:
        """Write messages as one chunk with its indices."""
        channels = [self._channel(topics[message.topic]) for message in messages]
        builder = RecordBuilder()
        for record in self._new:
            record.write(builder)
        places: dict[int, list[tuple[int, int]]] = defaultdict(list)
        for channel, message in zip(channels, messages, strict=True):
            places[channel].append((message.log_time_ns, builder.count))
            MessageRecord(
                channel_id=channel,
                log_time=message.log_time_ns,
                data=message.data,
                publish_time=message.publish_time_ns,
                sequence=message.sequence,
            ).write(builder)
        content = builder.end()
        first = min(message.log_time_ns for message in messages)
        last = max(message.log_time_ns for message in messages)
        parts = [
            _encoded(
                Chunk(
                    compression='',
                    data=content,
                    message_start_time=first,
                    message_end_time=last,
                    uncompressed_crc=zlib.crc32(content),
                    uncompressed_size=len(content),
                )
            )
        ]
        offsets = {}
        for channel, times in places.items():
            offsets[channel] = self.size + sum(map(len, parts))
            parts.append(_encoded(MessageIndex(channel_id=channel, records=times)))
        index = ChunkIndex(
            chunk_start_offset=self.size,
            chunk_length=len(parts[0]),
            message_start_time=first,
            message_end_time=last,
            message_index_offsets=offsets,
            message_index_length=sum(map(len, parts[1:])),
            compression='',
            compressed_size=len(content),
            uncompressed_size=len(content),
        )
        self._append(b''.join(parts))
        self._new.clear()
        self._chunk_count += 1
        self._chunk_indexes += _encoded(index)
        self._start_ns, self._end_ns = min(self._start_ns, first), max(self._end_ns, last)
        for channel in channels:
            self._counts[channel] += 1

    def sync(self) -> None:
        """Have the kernel put what is written on the disk itself."""
        os.fdatasync(self._stream.fileno())

    def close(self, topics: Iterable[RecordedTopic], metadata: dict[str, str]) -> None:
        """Add metadata and summary, and close; afterwards the file is whole."""
        try:
            for topic in topics:
                self._channel(topic)
            count = self.description.message_count
            start = self.size + len(_encoded(*self._new))
            record = _encoded(Metadata(name='rosbag2', metadata=metadata))
            head = _encoded(*self._new) + record + _encoded(DataEnd(0))
            statistics = Statistics(
                attachment_count=0,
                channel_count=len(self._channels),
                channel_message_counts=dict(self._counts),
                chunk_count=self._chunk_count,
                message_count=count,
                message_end_time=self._end_ns,
                message_start_time=self._start_ns if count else 0,
                metadata_count=1,
                schema_count=len(self._schemas),
            )
            definitions = [*self._schemas.values(), *self._channels.values()]
            index = MetadataIndex(offset=start, length=len(record), name='rosbag2')
            summary = _encoded(*definitions, statistics) + self._chunk_indexes + _encoded(index)
            footer = _encoded(Footer(self.size + len(head), 0, 0))[:-4]
            # The checksum covers the footer up to itself.
            checksum = zlib.crc32(footer, zlib.crc32(summary)).to_bytes(4, 'little')
            self._append(head + summary + footer + checksum + MAGIC)
            self.sync()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close without a summary: what is written can be recovered."""
        self._stream.close()

    def _channel(self, topic: RecordedTopic) -> int:
        known = self._channels.get(topic.name)
        if known is not None:
            return known.id
        schema = self._schemas.get(topic.type)
        if schema is None:
            schema = self._schemas[topic.type] = Schema(
                id=len(self._schemas) + 1,
                name=topic.type,
                encoding='ros2msg' if topic.definition else '',
                data=topic.definition.encode(),
            )
            self._new.append(schema)
        channel = self._channels[topic.name] = Channel(
            id=len(self._channels) + 1,
            topic=topic.name,
            message_encoding='cdr',
            schema_id=schema.id,
            metadata={
                'offered_qos_profiles': _yaml(qos_to_list(topic.offered_qos)).strip(),
                'topic_type_hash': topic.type_hash,
            },
        )
        self._new.append(channel)
        return channel.id

    def _append(self, data: bytes) -> None:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._stream.write(rest) :]
        except OSError:
            self._stream.truncate(self.size)
            self._stream.seek(self.size)
            raise
        self.size += len(data)


def _encoded(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


class _Dumper(yaml.SafeDumper):
    """Writes equal profiles out each time, as rosbag2 does, instead of referring to the first."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _yaml(content: object) -> str:
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, width=1000)
