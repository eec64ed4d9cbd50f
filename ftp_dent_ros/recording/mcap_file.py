"""One MCAP file while it is being written.

The records are those of the library `mcap`, but neither its ``Writer`` nor that of `rosbags`
writes the file: both keep a chunk in memory until it is full, so that a recorder that is killed
loses it, and neither can go back when the disk is full. Here the messages of a chunk are appended
as they come, behind a header that says that the chunk is open; its size and checksum are put
there when it ends. What has been written is whole messages, at any moment.
"""

from __future__ import annotations

import os
import zlib
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from ftp_dent_ros import __version__
from ftp_dent_ros.recording.chunk import Buffer, Entry, OpenChunk, message_records, records

MAGIC = b'\x89MCAP0\r\n'
# rosbag2 and Foxglove read a chunk at a time: small enough to hold many, large enough to be few.
CHUNK_SIZE = 1 << 22
_CHECKSUM_SIZE = 4
_BUFFERS_A_CALL = 1024  # IOV_MAX of Linux


class McapFile:
    """Writes a new file in profile ``ros2``, uncompressed, with chunk checksums and an index.

    Parameters
    ----------
    path : Path
        Must not exist.

    Raises
    ------
    OSError
        By every method that writes; the file then ends with the last whole message.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.message_count = 0
        self.start_ns = 0
        self.end_ns = 0
        self._end = 0  # of what is on the file for good
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._unwritten: list[McapRecord] = []
        self._chunk: OpenChunk | None = None
        self._chunk_count = 0
        self._chunk_indexes = bytearray()  # records: objects would be some times as large
        self._counts: dict[int, int] = defaultdict(int)
        self._descriptor = os.open(
            path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666
        )
        try:
            self._append([MAGIC, records(Header('ros2', f'ftp_dent_ros {__version__}'))])
        except OSError:
            self.abandon()
            path.unlink()
            raise

    @property
    def size(self) -> int:
        """Bytes on the file."""
        return self._end

    @property
    def summary_size(self) -> int:
        """About what `close` will add, in bytes."""
        index = 0 if self._chunk is None else self._chunk.index_size
        schemas = sum(len(schema.data) for schema in self._schemas.values())
        return 2000 + index + len(self._chunk_indexes) + schemas

    def add_channel(
        self, topic: str, type_name: str, encoding: str, definition: str, metadata: dict[str, str]
    ) -> int:
        """Number of a new channel for `Entry`; it is written with the next messages."""
        schema = Schema(
            id=len(self._schemas) + 1,
            name=type_name,
            encoding=encoding,
            data=definition.encode(),
        )
        for known in self._schemas.values():
            if (known.name, known.data) == (schema.name, schema.data):
                schema = known
        if schema.id not in self._schemas:
            self._schemas[schema.id] = schema
            self._unwritten.append(schema)
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding='cdr',
            schema_id=schema.id,
            metadata=metadata,
        )
        self._channels[channel.id] = channel
        self._unwritten.append(channel)
        return channel.id

    def write(self, entries: Sequence[Entry]) -> None:
        """Write messages; when it returns, the kernel has all of them."""
        if not entries:
            return
        if self._chunk is not None and self._chunk.size >= CHUNK_SIZE:
            self.end_chunk()
        definitions = records(*self._unwritten)
        content = message_records(definitions, entries)
        if self._chunk is None:
            chunk = OpenChunk(self._end)
            self._append([chunk.head_of_open(), *content])
            self._chunk = chunk
        else:
            self._append(content)
        self._unwritten.clear()
        self._chunk.add(definitions, entries, content)
        first = min(entry.log_time_ns for entry in entries)
        self.start_ns = first if self.message_count == 0 else min(self.start_ns, first)
        self.end_ns = max(self.end_ns, *(entry.log_time_ns for entry in entries))
        self.message_count += len(entries)
        for entry in entries:
            self._counts[entry.channel] += 1

    def end_chunk(self) -> None:
        """End the chunk that is being written, if there is one."""
        if self._chunk is None:
            return
        os.pwrite(self._descriptor, self._chunk.head(), self._chunk.start)
        indices = self._chunk.indices()
        offsets = _offsets(list(indices.values()), self._end)
        self._append(indices.values())
        self._chunk_indexes += self._chunk.summary(
            dict(zip(indices, offsets, strict=True)), sum(map(len, indices.values()))
        )
        self._chunk_count += 1
        self._chunk = None

    def sync(self) -> None:
        """End the chunk, and have the kernel put what is written on the disk itself.

        With a chunk at most as old as the last `sync`, a power cut that leaves a chunk with its
        size but without its data costs what came since.
        """
        self.end_chunk()
        os.fdatasync(self._descriptor)

    def close(self, name: str, metadata: Mapping[str, str]) -> None:
        """Add a metadata record and the summary, and close; afterwards the file is whole."""
        try:
            self.end_chunk()
            rest = records(*self._unwritten)
            record = records(Metadata(name=name, metadata=dict(metadata)))
            index = MetadataIndex(offset=self._end + len(rest), length=len(record), name=name)
            start = self._end + len(rest) + len(record)
            data_end = records(DataEnd(0))
            self._append([rest, record, data_end, *self._summary(index, start + len(data_end))])
            os.fdatasync(self._descriptor)
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close without a summary: what is written can be recovered."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _summary(self, metadata_index: MetadataIndex, start: int) -> list[bytes]:
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=self._chunk_count,
            message_count=self.message_count,
            message_end_time=self.end_ns,
            message_start_time=self.start_ns,
            metadata_count=1,
            schema_count=len(self._schemas),
        )
        parts = {
            Opcode.SCHEMA: records(*self._schemas.values()),
            Opcode.CHANNEL: records(*self._channels.values()),
            Opcode.STATISTICS: records(statistics),
            Opcode.CHUNK_INDEX: bytes(self._chunk_indexes),
            Opcode.METADATA_INDEX: records(metadata_index),
        }
        starts = _offsets(list(parts.values()), start)
        groups = [
            SummaryOffset(group_opcode=opcode, group_start=offset, group_length=len(part))
            for (opcode, part), offset in zip(parts.items(), starts, strict=True)
            if part
        ]
        offset_start = start + sum(map(len, parts.values()))
        summary = b''.join(parts.values()) + records(*groups)
        footer = Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=0)
        # The checksum covers the footer up to itself.
        head = records(footer)[:-_CHECKSUM_SIZE]
        checksum = zlib.crc32(head, zlib.crc32(summary))
        return [summary, head, checksum.to_bytes(_CHECKSUM_SIZE, 'little'), MAGIC]

    def _append(self, buffers: Iterable[Buffer]) -> None:
        try:
            self._end += _write_all(self._descriptor, buffers)
        except OSError:
            os.ftruncate(self._descriptor, self._end)
            os.lseek(self._descriptor, self._end, os.SEEK_SET)
            raise


def _offsets(parts: Sequence[bytes], start: int) -> list[int]:
    """Where each part begins, the first at `start`."""
    offsets = []
    for part in parts:
        offsets.append(start)
        start += len(part)
    return offsets


def _write_all(descriptor: int, buffers: Iterable[Buffer]) -> int:
    """Write everything without copying it together; the number of bytes."""
    views = deque(memoryview(buffer).cast('B') for buffer in buffers if len(buffer))
    total = 0
    while views:
        written = os.writev(descriptor, list(islice(views, _BUFFERS_A_CALL)))
        total += written
        while written:
            if written >= len(views[0]):
                written -= len(views.popleft())
            else:
                views[0] = views[0][written:]
                written = 0
    return total
