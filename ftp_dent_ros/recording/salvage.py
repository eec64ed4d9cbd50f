"""What is whole of an MCAP file whose writer was killed, or whose disk filled.

MCAP is read from front to back: each record has its length before it, so that the first one that
does not fit tells where the writer was stopped. Its promise is that of `recovery`: no reader of
`mcap` opens a chunk that was not closed.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.chunk import CHUNK_HEADER, RECORD_HEADER, content_of
from ftp_dent_ros.recording.mcap_file import MAGIC
from ftp_dent_ros.recording.reader import topic_from
from ftp_dent_ros.recording.topic import Message, Topic

_MESSAGE_FIELDS = struct.Struct('<HIQQ')
_PRIVATE_OPCODES = 0x80  # and above: extensions, to be skipped
_WANTED = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK)
_LARGEST_RECORD = 1 << 30  # bytes: what is larger is left out, and counted as damaged


class Salvage:
    """Reads what is whole of an MCAP file.

    Raises
    ------
    BagError
        It is empty, not an MCAP file, or holds something else than ROS 2 messages.

    Attributes
    ----------
    topics : dict of str to Topic
        Those met so far.
    end : int
        Offset behind the last whole record.
    whole : bool
        The file was read to its regular end, and nothing follows that.
    damaged : int
        Chunks whose checksum is wrong, and records that cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, Topic] = {}
        self.whole = False
        self.damaged = 0
        self.end = len(MAGIC)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Topic] = {}
        try:
            self.size = path.stat().st_size
            with path.open('rb') as stream:
                head = stream.read(len(MAGIC))
        except OSError as reason:
            raise BagError(f'{path}: cannot be read ({reason.strerror}): check it') from None
        if head != MAGIC:
            what = 'not an MCAP file' if head else 'an empty file'
            raise BagError(f'{path}: {what}: there is nothing to recover in it')

    @property
    def cut(self) -> int:
        """Bytes behind the last whole record."""
        return self.size - self.end

    def messages(self) -> Iterator[Message]:
        """Every whole message, in the order of the file."""
        with self.path.open('rb') as stream:
            stream.seek(self.end)
            for opcode, body, complete in _records(stream, self.size):
                if opcode == Opcode.CHUNK:
                    yield from self._chunk(body, complete)
                elif complete:
                    yield from self._record(opcode, body)
                if not complete:
                    return
                self.end = stream.tell()
                if opcode == Opcode.FOOTER:
                    if stream.read(len(MAGIC)) == MAGIC:
                        self.end = stream.tell()
                        self.whole = self.end == self.size
                    return

    def _chunk(self, body: bytes, complete: bool) -> Iterator[Message]:
        try:
            chunk = Chunk.read(ReadDataStream(io.BytesIO(body)))
            data = content_of(chunk, whole=complete)
        except Exception:  # whatever damaged data make of the libraries
            self.damaged += complete
            return
        stream = io.BytesIO(data)
        size = 0
        for opcode, record, record_complete in _records(stream, len(data)):
            if record_complete:
                yield from self._record(opcode, record)
                size = stream.tell()
        if not complete and not chunk.compression and size:
            self.end += CHUNK_HEADER.size + size

    def _record(self, opcode: int, body: bytes) -> Iterator[Message]:
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(io.BytesIO(body)))
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(io.BytesIO(body)))
                topic = topic_from(channel, self._schemas.get(channel.schema_id))
                self._channels[channel.id] = self.topics.setdefault(topic.name, topic)
            elif opcode == Opcode.MESSAGE:
                channel_id, sequence, log_time, publish_time = _MESSAGE_FIELDS.unpack_from(body)
                topic = self._channels[channel_id]
                data = body[_MESSAGE_FIELDS.size :]
                yield Message(topic.name, topic.type, log_time, publish_time, data, sequence)
        except (BagError, GeneratorExit):
            raise
        except Exception:  # whatever damaged data make of the library
            self.damaged += 1


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[int, bytes, bool]]:
    """Opcode and body of each record, and whether it is all there; ends with what is not.

    The body is given only of the records that are wanted, and of an incomplete one only of a
    chunk, which may hold whole ones.
    """
    while True:
        head = stream.read(RECORD_HEADER.size)
        rest = size - stream.tell()
        # Below 0 while a recorder still adds to the file.
        if len(head) < RECORD_HEADER.size or rest < 0:
            return
        opcode, length = RECORD_HEADER.unpack(head)
        if not (Opcode.HEADER <= opcode <= Opcode.DATA_END or opcode >= _PRIVATE_OPCODES):
            return
        if length <= rest:
            if opcode in _WANTED and length <= _LARGEST_RECORD:
                yield opcode, stream.read(length), True
            else:
                stream.seek(length, io.SEEK_CUR)
                yield opcode, b'', True
            continue
        wanted = min(rest, _LARGEST_RECORD) if opcode == Opcode.CHUNK else 0
        yield opcode, stream.read(wanted), False
        return
