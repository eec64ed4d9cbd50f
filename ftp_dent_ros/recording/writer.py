"""A bag while it is being written: its folder, its files, and its metadata at the end.

`rosbags` has a writer too. This one splits a recording into files, ends as a whole bag where the
disk is full, and loses nothing to a kill: see `mcap_file`.
"""

from __future__ import annotations

import errno
import math
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.chunk import Entry
from ftp_dent_ros.recording.mcap_file import McapFile
from ftp_dent_ros.recording.metadata import (
    NO_TIME_NS,
    BagFile,
    BagMetadata,
    distribution,
    metadata_to_mapping,
    metadata_to_yaml,
    write_metadata,
)
from ftp_dent_ros.recording.reserve import NO_SPACE, Reserve
from ftp_dent_ros.recording.topic import Message, Topic, qos_to_yaml

_AT_ONCE = 1 << 20  # bytes: so much at most is lost of what is being written as the disk fills
_INDEX_SIZE = 16  # bytes that each message adds to the end of its chunk


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
        What the metadata say beside; may grow until the bag is closed.

    Raises
    ------
    BagError
        The folder exists or cannot be made. By `write` and `close`: the disk is full or fails.
    """

    def __init__(self, folder: Path, name: str = '', max_file_size: int = 0) -> None:
        self.folder = folder
        self.size = 0  # of all files, in bytes
        self.message_count = 0
        self.message_counts: dict[str, int] = defaultdict(int)
        self.custom_data: dict[str, str] = {}
        self._name = name or folder.resolve().name
        self._max_file_size = max_file_size
        self._topics: dict[str, Topic] = {}
        self._channels: dict[str, int] = {}
        self._files: list[BagFile] = []
        self._closed_size = 0
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise BagError(
                f'{folder}: exists already and is not overwritten: choose another output folder'
            ) from None
        except OSError as reason:
            raise self._failure(reason) from None
        self._reserve = Reserve(folder)
        try:
            self._file = self._next_file()
        except BagError:
            self._reserve.release()
            folder.rmdir()
            raise

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Those made known so far."""
        return tuple(self._topics.values())

    def add_topic(self, topic: Topic) -> None:
        """Make a topic known before its first message; a second time changes nothing."""
        self._topics.setdefault(topic.name, topic)

    def write(self, messages: Iterable[Message]) -> None:
        """Write messages of known topics; when it returns, the kernel has them."""
        batch: list[Message] = []
        size = 0
        for message in messages:
            batch.append(message)
            size += len(message.data)
            if size >= min(_AT_ONCE, self._room()):
                self._write(batch)
                batch, size = [], 0
        self._write(batch)

    def sync(self) -> None:
        """Have what is written outlive a power cut too; takes as long as the disk needs."""
        try:
            self._file.sync()
        except OSError as reason:
            raise self._failure(reason) from None

    def split(self) -> None:
        """Close the file and begin the next one."""
        self._close_file()
        self._file = self._next_file()
        self._reserve = Reserve(self.folder)

    def close(self) -> BagMetadata:
        """Close the file and write ``metadata.yaml``: the bag is whole."""
        self._close_file()
        metadata = self._metadata(self._files)
        try:
            write_metadata(self.folder, metadata)
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
            self._reserve.release()
            self._file.abandon()

    def _channel(self, name: str) -> int:
        channel = self._channels.get(name)
        if channel is None:
            topic = self._topics[name]
            channel = self._channels[name] = self._file.add_channel(
                name,
                topic.type,
                topic.definition.encoding,
                topic.definition.text,
                {
                    'offered_qos_profiles': qos_to_yaml(topic.offered_qos),
                    'topic_type_hash': topic.type_hash,
                },
            )
        return channel

    def _write(self, messages: list[Message]) -> None:
        entries = [
            Entry(
                self._channel(message.topic),
                message.sequence,
                message.log_time_ns,
                message.publish_time_ns,
                message.data,
            )
            for message in messages
        ]
        try:
            self._reserve.hold(self._file.summary_size + _INDEX_SIZE * len(entries))
            self._file.write(entries)
        except OSError as reason:
            raise self._failure(reason) from None
        self.size = self._closed_size + self._file.size
        for message in messages:
            self.message_counts[message.topic] += 1
        self.message_count += len(messages)
        if 0 < self._max_file_size <= self._file.size:
            self.split()

    def _room(self) -> float:
        """Bytes of messages after which the file is full, however they were handed over."""
        return self._max_file_size - self._file.size if self._max_file_size else math.inf

    def _next_file(self) -> McapFile:
        self._channels.clear()
        try:
            return McapFile(self.folder / f'{self._name}_{len(self._files)}.mcap')
        except OSError as reason:
            raise self._failure(reason) from None

    def _close_file(self) -> None:
        self._reserve.release()
        for name in list(self._topics):
            self._channel(name)
        file = self._file
        described = BagFile(
            path=file.path.name,
            start_ns=file.start_ns if file.message_count else NO_TIME_NS,
            duration_ns=file.end_ns - file.start_ns,
            message_count=file.message_count,
        )
        mapping = metadata_to_mapping(self._metadata([*self._files, described]))
        try:
            file.close('rosbag2', {'serialized_metadata': metadata_to_yaml(mapping)})
        except OSError as reason:
            raise self._failure(reason) from None
        self._files.append(described)
        self._closed_size += file.size
        self.size = self._closed_size

    def _metadata(self, files: Iterable[BagFile]) -> BagMetadata:
        return BagMetadata(
            files=tuple(files),
            topics=self.topics,
            message_counts=dict(self.message_counts),
            ros_distro=distribution(),
            custom_data=self.custom_data,
        )

    def _failure(self, reason: OSError) -> BagError:
        if reason.errno in NO_SPACE:
            what, advice = 'the disk is full', 'free some space'
        elif reason.errno == errno.EFBIG:
            what = 'the file has grown to the limit of its file system or user'
            advice = 'record smaller files with --max-bag-size'
        else:
            what, advice = f'cannot be written ({reason.strerror})', 'check the disk'
        return BagError(f'{self.folder}: {what}: {advice}')
