"""Reading bags: rosbag2 folders with MCAP files, and bare ``.mcap`` files.

>>> bag = open_bag('out/demo/bag')
>>> for message in bag.messages(['/points']):
...     cloud = bag.deserialise(message)
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import SeekingReader
from mcap.records import Channel, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.topic import (
    Message,
    RecordedTopic,
    deserialise,
    plain_topic,
    qos_from,
)
from ftp_dent_ros.recording.writer import METADATA_FILE, NO_TIME_NS
from ftp_dent_ros.yaml_file import read_yaml


@dataclass(frozen=True)
class Bag:
    """A whole bag that can be read.

    Attributes
    ----------
    path : Path
        The folder or the file.
    files : tuple of Path
        Its MCAP files, in order.
    topics : tuple of RecordedTopic
        As they were recorded; a name is there twice if messages of two types were recorded of it.
    message_counts : mapping of str to int
        By topic.
    start_ns : int
        Log time of the first message, ns since the epoch; `NO_TIME_NS` if there is none.
    coded : mapping
        Names of topics that are stored compressed, and what they stand for.
    """

    path: Path
    files: tuple[Path, ...]
    topics: tuple[RecordedTopic, ...]
    message_counts: Mapping[str, int]
    start_ns: int
    coded: Mapping[str, str]

    def topics_of(self, names: Collection[str]) -> list[RecordedTopic]:
        """Topics of these names; raises `BagError` if the bag has not all of them."""
        known = {topic.name for topic in self.topics}
        for unknown in sorted(set(names) - known):
            there = ', '.join(sorted(known)) or 'none'
            raise BagError(f'{self.path}: has no topic {unknown}: it has {there}')
        return [topic for topic in self.topics if topic.name in names]

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Messages in the order in which they were received.

        Parameters
        ----------
        topics : collection of str, optional
            Names of the topics wanted; all by default.

        Raises
        ------
        BagError
            A topic is not in the bag, or the data are damaged.
        """
        if topics is not None:
            self.topics_of(topics)
            topics = {*topics, *(code for code, name in self.coded.items() if name in topics)}
        for path in self.files:
            with _whole_file(path) as reader:
                for schema, channel, record in reader.iter_messages(topics):
                    message = Message(
                        channel.topic,
                        schema.name if schema else '',
                        record.log_time,
                        record.publish_time,
                        record.data,
                        record.sequence,
                    )
                    if channel.topic in self.coded:
                        # Only this needs OpenCV.
                        from ftp_dent_ros.recording.compression import decoded

                        message = decoded(message, self.coded[channel.topic])
                    yield message

    def deserialise(self, message: Message) -> Any:
        """Content of a message of this bag, without ROS: see `topic.deserialise`."""
        wanted = (message.topic, message.type)
        topic = next(each for each in self.topics if (each.name, each.type) == wanted)
        return deserialise(message.data, message.type, topic.definition)


def open_bag(path: str | os.PathLike[str]) -> Bag:
    """Open a bag's folder, or one MCAP file, without reading its messages.

    Raises
    ------
    BagError
        It is not there, not a bag, or its recorder did not come to close it.
    """
    path = Path(path)
    if not path.exists():
        raise BagError(f'{path}: no such bag: check the path')
    files = _files_of(path) if path.is_dir() else [path]
    topics: dict[tuple[str, str], RecordedTopic] = {}
    counts: Counter[str] = Counter()
    coded: dict[str, str] = {}
    start_ns = NO_TIME_NS
    for file in files:
        with _whole_file(file) as reader:
            summary = reader.get_summary()
            if summary is None or summary.statistics is None:
                raise ValueError('it has no index')
            for channel in summary.channels.values():
                stored = topic_from(channel, summary.schemas.get(channel.schema_id))
                topic = plain_topic(stored)
                if topic is not stored:
                    coded[stored.name] = topic.name
                topics.setdefault((topic.name, topic.type), topic)
                counts[topic.name] += summary.statistics.channel_message_counts.get(channel.id, 0)
        if summary.statistics.message_count:
            start_ns = min(start_ns, summary.statistics.message_start_time)
    return Bag(path, tuple(files), tuple(topics.values()), counts, start_ns, coded)


def topic_from(channel: Channel, schema: Schema | None) -> RecordedTopic:
    """What a channel says about its topic.

    Raises
    ------
    BagError
        Its messages are not ROS 2's.
    """
    if channel.message_encoding != 'cdr':
        raise BagError(
            f"{channel.topic} holds {channel.message_encoding} messages, not ROS 2's cdr: "
            'only bags of ROS 2 are read here'
        )
    described = schema is not None and schema.encoding == 'ros2msg'
    return RecordedTopic(
        name=channel.topic,
        type=schema.name if schema else '',
        type_hash=channel.metadata.get('topic_type_hash', ''),
        offered_qos=qos_from(channel.metadata.get('offered_qos_profiles', '')),
        definition=schema.data.decode() if schema is not None and described else '',
    )


def _files_of(folder: Path) -> list[Path]:
    """Files of a bag's folder, as its metadata have them."""
    path = folder / METADATA_FILE
    if not path.is_file():
        if not any(folder.glob('*.mcap')):
            raise BagError(f'{folder}: holds no MCAP file: check the path')
        raise BagError(
            f'{folder}: has no {METADATA_FILE}, so its recorder did not come to close it: '
            f'make a whole bag of it with `ftp-dent recover {folder} --output NEW`'
        )
    data = read_yaml(path, BagError)
    try:
        information = data['rosbag2_bagfile_information']
        storage, mode = information['storage_identifier'], information.get('compression_mode', '')
        # Before version 4 the names included the bag's own folder.
        files = [folder / Path(name).name for name in information['relative_file_paths']]
    except (KeyError, TypeError, ValueError, AttributeError) as reason:
        raise BagError(
            f'{path}: not a rosbag2 metadata file ({type(reason).__name__}: {reason}): '
            f'make a whole bag of {folder} with `ftp-dent recover`'
        ) from None
    if storage != 'mcap' or mode not in ('', 'NONE', 'none'):
        raise BagError(
            f'{folder}: stored as {storage} {mode}'.rstrip()
            + ', and only MCAP is read here: convert it with `ros2 bag convert`'
        )
    return files


@contextmanager
def _whole_file(path: Path) -> Iterator[SeekingReader]:
    """Open an MCAP file; whatever the library makes of damaged data becomes a BagError."""
    try:
        stream = path.open('rb')
    except OSError as reason:
        raise BagError(f'{path}: cannot be read ({reason.strerror}): check the path') from None
    with stream:
        head = stream.read(len(MAGIC))
        if head != MAGIC:
            what = 'not an MCAP file' if head else 'an empty file'
            raise BagError(f'{path}: {what}: there is nothing to read in it')
        stream.seek(0)
        try:
            size = path.stat().st_size
            yield SeekingReader(stream, validate_crcs=True, record_size_limit=size)
        except BagError as error:
            raise BagError(f'{path}: {error}') from None
        except Exception as reason:
            bag = path.parent if (path.parent / METADATA_FILE).is_file() else path
            raise BagError(
                f'{path}: not a whole MCAP file ({reason or type(reason).__name__}): '
                f'make a whole bag of it with `ftp-dent recover {bag} --output NEW`'
            ) from None
