"""One chunk of an MCAP file: while it is being written, and what it holds when it is read.

Its promises: a recorder that is killed loses no message (the chunk lies on the disk while it is
open), and a file that decompresses to more than any recorder writes is refused. `mcap` keeps an
open chunk in memory, and decompresses whatever a file says.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from collections.abc import Iterable, Sequence
from io import BytesIO
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex, McapRecord, MessageIndex

# MCAP specification, "Message" and "Chunk": opcode, length, then the fields before the payload.
RECORD_HEADER = struct.Struct('<BQ')
CHUNK_HEADER = struct.Struct('<BQQQQIIQ')
MESSAGE_HEADER = struct.Struct('<BQHIQQ')
# What an open chunk says of its length: no file goes so far, so that it is known to be open.
_OPEN = 1 << 62
# More than any recorder puts into a chunk that it compresses: a chunk that gives more is a bomb.
_LARGEST = 1 << 28

Buffer = bytes | bytearray | memoryview


class Entry(NamedTuple):
    """A message on its way to the file."""

    channel: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: Buffer


class OpenChunk:
    """What has been written of a chunk that begins at the offset `start` of its file."""

    def __init__(self, start: int) -> None:
        self.start = start
        self.size = 0  # of its content, in bytes
        self.first_ns = 0
        self.last_ns = 0
        self._checksum = 0
        self._index: dict[int, list[tuple[int, int]]] = defaultdict(list)

    @property
    def index_size(self) -> int:
        """Bytes of its indices."""
        times = sum(map(len, self._index.values()))
        return 16 * times + (RECORD_HEADER.size + 6) * len(self._index)

    def add(self, definitions: bytes, entries: Sequence[Entry], content: Iterable[Buffer]) -> None:
        """Take note of messages whose `content` has been written."""
        offset = self.size + len(definitions)
        for entry in entries:
            self._index[entry.channel].append((entry.log_time_ns, offset))
            offset += MESSAGE_HEADER.size + len(entry.data)
        times = [entry.log_time_ns for entry in entries]
        self.first_ns = min(times) if self.size == 0 else min(self.first_ns, *times)
        self.last_ns = max(self.last_ns, *times)
        for buffer in content:
            self._checksum = zlib.crc32(buffer, self._checksum)
        self.size = offset

    @staticmethod
    def head_of_open() -> bytes:
        """Header of a chunk whose end is not known yet."""
        return CHUNK_HEADER.pack(Opcode.CHUNK, _OPEN, 0, 0, _OPEN, 0, 0, _OPEN)

    def head(self) -> bytes:
        """Header of the chunk as it is now."""
        length = CHUNK_HEADER.size - RECORD_HEADER.size + self.size
        times = self.first_ns, self.last_ns
        return CHUNK_HEADER.pack(
            Opcode.CHUNK, length, *times, self.size, self._checksum, 0, self.size
        )

    def indices(self) -> dict[int, bytes]:
        """The records that follow it: by channel, where its messages are."""
        return {
            channel: records(MessageIndex(channel_id=channel, records=times))
            for channel, times in self._index.items()
        }

    def summary(self, offsets: dict[int, int], index_size: int) -> bytes:
        """The chunk's record at the end of the file, `offsets` being those of its indices."""
        return records(
            ChunkIndex(
                chunk_start_offset=self.start,
                chunk_length=CHUNK_HEADER.size + self.size,
                message_start_time=self.first_ns,
                message_end_time=self.last_ns,
                message_index_offsets=offsets,
                message_index_length=index_size,
                compression='',
                compressed_size=self.size,
                uncompressed_size=self.size,
            )
        )


def message_records(definitions: bytes, entries: Iterable[Entry]) -> list[Buffer]:
    """Content of a chunk: new schemas and channels, then messages, none of them copied."""
    content: list[Buffer] = [definitions] if definitions else []
    for entry in entries:
        length = MESSAGE_HEADER.size - RECORD_HEADER.size + len(entry.data)
        content += [MESSAGE_HEADER.pack(Opcode.MESSAGE, length, *entry[:4]), entry.data]
    return content


def records(*of_library: McapRecord) -> bytes:
    """Records as they are in a file."""
    builder = RecordBuilder()
    for record in of_library:
        record.write(builder)
    return builder.end()


def content_of(chunk: Chunk, whole: bool = True) -> bytes:
    """What a chunk holds, decompressed.

    Parameters
    ----------
    chunk : Chunk
    whole : bool
        False of the beginning of one, whose size and checksum tell nothing.

    Raises
    ------
    ValueError
        It holds more than it says, or more than any recorder puts into one, or its checksum is
        wrong. Never is more decompressed than that.
    """
    limit = _LARGEST if not whole else min(chunk.uncompressed_size, _LARGEST)
    if not chunk.compression:
        data = chunk.data
    elif chunk.uncompressed_size > _LARGEST:
        size = f'{chunk.uncompressed_size / 1e6:.0f} MB'
        raise ValueError(f'a chunk says that it holds {size} in {len(chunk.data)} bytes')
    elif chunk.compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(BytesIO(chunk.data)) as stream:
            data = stream.read(limit + 1)
    elif chunk.compression == 'lz4':
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=limit + 1)
    else:
        raise ValueError(f'the compression {chunk.compression!r} is not known')
    if whole and len(data) != chunk.uncompressed_size:
        raise ValueError(f'a chunk does not hold the {chunk.uncompressed_size} bytes that it says')
    if whole and chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError('the checksum of a chunk is wrong')
    return data
