"""The messages of a whole MCAP file, in the order of their reception.

The records and the summary are read by the library `mcap`; its reader of messages is not used,
because it decompresses whatever a file says. Here nothing is read or decompressed that is larger
than the file or the bound of `chunk.content_of`.
"""

from __future__ import annotations

import heapq
import os
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, McapRecord, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from ftp_dent_ros.recording.chunk import RECORD_HEADER, content_of
from ftp_dent_ros.recording.topic import Message


def summary_of(stream: BinaryIO) -> Summary | None:
    """What the end of a file says of it; None if it has no summary."""
    return SeekingReader(stream, record_size_limit=_size(stream)).get_summary()


def stored_messages(
    stream: BinaryIO, topics: Collection[str] | None, start_ns: int | None
) -> Iterator[Message]:
    """Messages of some topics, or all, that were received at `start_ns` or later.

    Raises
    ------
    Exception
        The library's own errors, of several kinds, and ValueError where a chunk holds something
        else than it says: the file is damaged, or a bomb.
    """
    summary = summary_of(stream)
    if summary is None or not summary.chunk_indexes:
        found = _in_order_of_file(stream)
    else:
        indexes = [
            index
            for index in {
                index.chunk_start_offset: index for index in summary.chunk_indexes
            }.values()
            if (start_ns is None or index.message_end_time >= start_ns)
            and _may_hold(index, summary, topics)
        ]
        found = _in_order_of_time(stream, indexes, summary)
    for schema, channel, record in found:
        wanted = topics is None or channel.topic in topics
        if wanted and (start_ns is None or record.log_time >= start_ns):
            yield Message(
                channel.topic,
                schema.name if schema else '',
                record.log_time,
                record.publish_time,
                record.data,
                record.sequence,
            )


_Found = tuple['Schema | None', Channel, Record]


def _in_order_of_time(
    stream: BinaryIO, indexes: Iterable[ChunkIndex], summary: Summary
) -> Iterator[_Found]:
    """Only chunks whose times overlap are held at once."""
    # What is waiting, by time, then by place in the file: chunks to be read (None), and messages.
    waiting: list[tuple[int, int, int, Record | None]] = [
        (index.message_start_time, index.chunk_start_offset, -1, None) for index in indexes
    ]
    heapq.heapify(waiting)
    while waiting:
        _, offset, _, record = heapq.heappop(waiting)
        if record is not None:
            channel = summary.channels[record.channel_id]
            yield summary.schemas.get(channel.schema_id), channel, record
            continue
        stream.seek(offset)
        for place, each in enumerate(_content(_chunk(stream))):
            if isinstance(each, Record):
                heapq.heappush(waiting, (each.log_time, offset, place, each))


def _in_order_of_file(stream: BinaryIO) -> Iterator[_Found]:
    """Of a file without an index: it would have to be sorted as a whole, in memory."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    stream.seek(0)
    reader = StreamReader(stream, emit_chunks=True, record_size_limit=_size(stream))
    for outer in reader.records:
        for record in _content(outer) if isinstance(outer, Chunk) else (outer,):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Record):
                channel = channels[record.channel_id]
                yield schemas.get(channel.schema_id), channel, record


def _chunk(stream: BinaryIO) -> Chunk:
    """The chunk at the stream's place."""
    opcode, length = RECORD_HEADER.unpack(stream.read(RECORD_HEADER.size))
    if opcode != Opcode.CHUNK or length > _size(stream) - stream.tell():
        raise ValueError('its index points at what is no whole chunk')
    return Chunk.read(ReadDataStream(stream))


def _content(chunk: Chunk) -> list[McapRecord]:
    return breakup_chunk(replace(chunk, compression='', data=content_of(chunk)))


def _may_hold(index: ChunkIndex, summary: Summary, topics: Collection[str] | None) -> bool:
    held = index.message_index_offsets
    if topics is None or not held:
        return True
    return any(summary.channels[channel].topic in topics for channel in held)


def _size(stream: BinaryIO) -> int:
    return os.fstat(stream.fileno()).st_size
