"""One MCAP file while it is being written, chunk by chunk.

The records are those of the library `mcap`; its ``Writer`` is not used, because it counts a
message before the disk has taken it and cannot go back when the disk is full. Here a chunk is on
the file or it is not: what is written is whole messages, at any moment.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
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
    SummaryOffset,
)

from ftp_dent_ros import __version__

MAGIC = b'\x89MCAP0\r\n'

# MCAP specification, "Message" and "Chunk": opcode, length, then the fields before the payload.
MESSAGE_HEADER = struct.Struct('<BQHIQQ')
CHUNK_HEADER = struct.Struct('<BQQQQIIQ')
RECORD_HEADER = struct.Struct('<BQ')
_CHECKSUM = struct.Struct('<I')
_BUFFERS_A_CALL = 1024  # IOV_MAX of Linux

Buffer = bytes | bytearray | memoryview


class Entry(NamedTuple):
    """A message on its way to the file."""

    channel: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: Buffer


class McapFile:
    """Writes a new file in profile ``ros2``, uncompressed, with chunk checksums and an index.

    Parameters
    ----------
    path : Path
        Must not exist.

    Raises
    ------
    OSError
        By every method that writes; the file then ends with the last whole chunk.
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
        self._chunks: list[ChunkIndex] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._descriptor = os.open(
            path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666
        )
        try:
            self._append([MAGIC, _records(Header('ros2', f'ftp_dent_ros {__version__}'))])
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
        return 1000 + 200 * len(self._chunks) + sum(len(s.data) for s in self._schemas.values())

    def add_channel(
        self, topic: str, type_name: str, encoding: str, definition: str, metadata: dict[str, str]
    ) -> int:
        """Number of a new channel for `Entry`; it is written with the next chunk."""
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
        """Write messages as one chunk; when it returns, the kernel has all of it."""
        if not entries:
            return
        buffers: list[Buffer] = [_records(*self._unwritten)]
        size = len(buffers[0])
        index: dict[int, list[tuple[int, int]]] = defaultdict(list)
        for entry in entries:
            index[entry.channel].append((entry.log_time_ns, size))
            length = MESSAGE_HEADER.size - RECORD_HEADER.size + len(entry.data)
            buffers += [MESSAGE_HEADER.pack(Opcode.MESSAGE, length, *entry[:4]), entry.data]
            size += RECORD_HEADER.size + length
        first = min(entry.log_time_ns for entry in entries)
        last = max(entry.log_time_ns for entry in entries)
        head = CHUNK_HEADER.pack(
            Opcode.CHUNK,
            CHUNK_HEADER.size - RECORD_HEADER.size + size,
            first,
            last,
            size,
            _checksum(buffers),
            0,  # length of the compression's name
            size,
        )
        indices = [_records(MessageIndex(channel_id=channel, records=times)) for channel, times in index.items()]
        offsets = self._offsets(indices, self._end + len(head) + size)
        chunk = ChunkIndex(
            chunk_start_offset=self._end,
            chunk_length=len(head) + size,
            message_start_time=first,
            message_end_time=last,
            message_index_offsets=dict(zip(index, offsets, strict=True)),
            message_index_length=sum(map(len, indices)),
            compression='',
            compressed_size=size,
            uncompressed_size=size,
        )
        self._append([head, *buffers, *indices])
        self._unwritten.clear()
        self._chunks.append(chunk)
        self.start_ns = first if self.message_count == 0 else min(self.start_ns, first)
        self.end_ns = max(self.end_ns, last)
        self.message_count += len(entries)
        for channel, times in index.items():
            self._counts[channel] += len(times)

    def close(self, name: str, metadata: Mapping[str, str]) -> None:
        """Add a metadata record and the summary, and close; afterwards the file is whole."""
        try:
            rest = _records(*self._unwritten)
            record = _records(Metadata(name=name, metadata=dict(metadata)))
            index = MetadataIndex(offset=self._end + len(rest), length=len(record), name=name)
            start = self._end + len(rest) + len(record)
            data_end = _records(DataEnd(0))
            self._append([rest, record, data_end, *self._summary(index, start + len(data_end))])
            os.fsync(self._descriptor)
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
            chunk_count=len(self._chunks),
            message_count=self.message_count,
            message_end_time=self.end_ns,
            message_start_time=self.start_ns,
            metadata_count=1,
            schema_count=len(self._schemas),
        )
        groups: dict[Opcode, Iterable[McapRecord]] = {
            Opcode.SCHEMA: self._schemas.values(),
            Opcode.CHANNEL: self._channels.values(),
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.METADATA_INDEX: [metadata_index],
        }
        parts = {opcode: _records(*records) for opcode, records in groups.items()}
        starts = self._offsets(list(parts.values()), start)
        offsets = [
            SummaryOffset(group_opcode=opcode, group_start=offset, group_length=len(part))
            for (opcode, part), offset in zip(parts.items(), starts, strict=True)
            if part
        ]
        offset_start = start + sum(map(len, parts.values()))
        summary = b''.join(parts.values()) + _records(*offsets)
        # The checksum covers the footer up to itself.
        footer = _records(
            Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=0)
        )[: -_CHECKSUM.size]
        checksum = zlib.crc32(footer, zlib.crc32(summary))
        return [summary, footer, _CHECKSUM.pack(checksum), MAGIC]

    @staticmethod
    def _offsets(parts: Sequence[bytes], start: int) -> list[int]:
        offsets = []
        for part in parts:
            offsets.append(start)
            start += len(part)
        return offsets

    def _append(self, buffers: Iterable[Buffer]) -> None:
        try:
            self._end += _write_all(self._descriptor, buffers)
        except OSError:
            os.ftruncate(self._descriptor, self._end)
            os.lseek(self._descriptor, self._end, os.SEEK_SET)
            raise


def _records(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def _checksum(buffers: Iterable[Buffer]) -> int:
    checksum = 0
    for buffer in buffers:
        checksum = zlib.crc32(buffer, checksum)
    return checksum


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
