"""``ftp-dent recover``: a whole bag from one whose recorder was killed, or whose disk filled.

MCAP is read from front to back: the first record that does not fit tells where the writer was
stopped. Every whole chunk before it comes back.
"""

from __future__ import annotations

import argparse
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Channel, Chunk, Footer, McapRecord, Schema
from mcap.records import Message as MessageRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC as MAGIC
from tqdm import tqdm

from ftp_dent_ros.cli import argument
from ftp_dent_ros.errors import BagError, printable
from ftp_dent_ros.files import by_number
from ftp_dent_ros.recording.reader import topic_from
from ftp_dent_ros.recording.topic import Message, RecordedTopic
from ftp_dent_ros.recording.writer import BagWriter

ARGUMENTS = (
    argument('bag', type=Path, help='folder of the bag, or an .mcap file'),
    argument(
        '-o', '--output', type=Path, required=True, help='folder of the new bag: must not exist'
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Write the new bag and say what was saved; the old one is left as it is."""
    size = sum(path.stat().st_size for path in mcap_files(arguments.bag))
    with tqdm(total=size, unit='B', unit_scale=True, disable=None, leave=False) as bar:
        recovery = recover(arguments.bag, arguments.output, bar.update)
    counts = recovery.message_counts
    print(f'{arguments.output}: {sum(counts.values())} messages of {len(counts)} topics')
    for topic in sorted(counts):
        print(f'  {counts[topic]:8d}  {printable(topic)}')
    for name, size in recovery.cut.items():
        print(f'{printable(name)}: cut {size} bytes at the end, which hold no whole message')
    if recovery.damaged:
        print(f'left out {recovery.damaged} damaged chunks or records')
    return 0


@dataclass
class Recovery:
    """What was saved and what was not.

    Attributes
    ----------
    message_counts : dict of str to int
        Messages saved, by topic, topics without any included.
    cut : dict of str to int
        Bytes at the end of files, by file name, that hold no whole record; only files that have
        such bytes.
    damaged : int
        Chunks left out because their checksum is wrong.
    """

    message_counts: dict[str, int] = field(default_factory=dict)
    cut: dict[str, int] = field(default_factory=dict)
    damaged: int = 0


def recover(
    bag: Path, output: Path, progress: Callable[[int], object] = lambda size: None
) -> Recovery:
    """Write a new whole bag with every whole chunk of `bag`, which is left as it is.

    Parameters
    ----------
    bag : Path
        Folder or ``.mcap`` file.
    output : Path
        Folder of the new bag; appears when it is complete, and must not exist.
    progress : callable, optional
        Called with each number of bytes read.

    Raises
    ------
    BagError
        Nothing there is an MCAP file, or the output exists or cannot be written.
    """
    files = mcap_files(bag)
    recovery = Recovery()
    if output.exists():
        raise BagError(
            f'{output}: exists already and is not overwritten: choose another output folder'
        )
    # The file in a bag is called as the bag.
    hidden = output.with_name(f'.{output.name}.{os.getpid()}') / output.name
    try:
        with BagWriter(hidden) as writer:
            for path in files:
                writer.write(_messages(path, writer, recovery, progress))
            if all(recovery.cut.get(path.name, 0) == path.stat().st_size for path in files):
                raise BagError(f'{bag}: holds no whole part of an MCAP file: nothing to recover')
        os.rename(hidden, output)
    except BagError as error:
        raise BagError(str(error).replace(str(hidden), str(output))) from None
    finally:
        shutil.rmtree(hidden.parent, ignore_errors=True)
    recovery.message_counts = {
        topic.name: writer.message_counts[topic.name] for topic in writer.topics
    }
    return recovery


def mcap_files(bag: Path) -> list[Path]:
    """The MCAP files of a bag's folder in the order of recording, or the one file given.

    Raises
    ------
    BagError
        There is none.
    """
    files = [bag] if bag.is_file() else sorted(bag.glob('*.mcap'), key=by_number)
    if not files:
        raise BagError(f'{bag}: no such bag, or one without MCAP files: check the path')
    return files


def _messages(
    path: Path, writer: BagWriter, recovery: Recovery, progress: Callable[[int], object]
) -> Iterator[Message]:
    """Every message of whole records, in the order of the file; their topics go to `writer`."""
    schemas: dict[int, Schema] = {}
    topics: dict[int, RecordedTopic] = {}
    for record in _records(path, recovery):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            topic = topics[record.id] = topic_from(record, schemas.get(record.schema_id))
            writer.add_topic(topic)
        elif isinstance(record, MessageRecord) and record.channel_id in topics:
            topic = topics[record.channel_id]
            progress(len(record.data))
            times = record.log_time, record.publish_time
            yield Message(topic.name, topic.type, *times, record.data, record.sequence)


def _records(path: Path, recovery: Recovery) -> Iterator[McapRecord]:
    """Records of a file until the first that is not whole."""
    size, end = path.stat().st_size, 0
    with path.open('rb') as stream:
        reader = StreamReader(stream, emit_chunks=True, record_size_limit=size)
        records = iter(reader.records)
        while True:
            try:
                record = next(records)
            except Exception:  # the end of the file, and whatever damaged data make of the library
                break
            if stream.tell() > size:
                break
            end = stream.tell() + (len(MAGIC) if isinstance(record, Footer) else 0)
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                content = breakup_chunk(record, validate_crc=True)
            except Exception:
                recovery.damaged += 1
                continue
            yield from content
    if end < size:
        recovery.cut[path.name] = size - end
