"""Reading bags: rosbag2 folders with MCAP files, and bare ``.mcap`` files.

Its promise: compressed topics are read as what they stand for, and a hostile file is refused.

>>> bag = open_bag('out/demo/bag')
>>> for message in bag.messages(['/points']):
...     cloud = bag.deserialise(message)
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

from mcap.records import Channel, Schema

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.mcap_file import MAGIC
from ftp_dent_ros.recording.metadata import (
    METADATA_FILE,
    NO_TIME_NS,
    BagFile,
    BagMetadata,
    read_metadata,
)
from ftp_dent_ros.recording.stored import stored_messages, summary_of
from ftp_dent_ros.recording.topic import SUFFIXES, Definition, Message, Qos, Topic, qos_from

_LONGEST_QOS = 1 << 20  # characters: of some thousand publishers


@dataclass(frozen=True)
class Bag:
    """A whole bag that can be read.

    Attributes
    ----------
    path : Path
        The folder or the file.
    files : tuple of Path
        Its MCAP files, in order.
    metadata : BagMetadata
        Topics, counts and times, as they were recorded.
    coded : dict
        Names of topics that were compressed as they were recorded, and what they stand for.
    """

    path: Path
    files: tuple[Path, ...]
    metadata: BagMetadata
    coded: dict[str, str] = field(default_factory=dict)

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[Message]:
        """Messages in the order in which they were received.

        Parameters
        ----------
        topics : collection of str, optional
            Names of the topics wanted; all by default.
        start_ns : int, optional
            Log time of the first message wanted.

        Raises
        ------
        BagError
            A topic is not in the bag, or the data are damaged.
        """
        known = {topic.name for topic in self.metadata.topics}
        unknown = sorted(set(topics or ()) - known)
        if unknown:
            there = ', '.join(sorted(known)) or 'none'
            raise BagError(f'{self.path}: has no topic {unknown[0]}: it has {there}')
        return self._messages(topics, start_ns)

    def deserialise(self, message: Message) -> Any:
        """Content of a message of this bag, without ROS: see `definitions.deserialise`."""
        # Only this needs the library `rosbags`.
        from ftp_dent_ros.recording.definitions import deserialise

        wanted = (message.topic, message.type)
        topic = next(each for each in self.metadata.topics if (each.name, each.type) == wanted)
        return deserialise(message.data, message.type, topic.definition)

    def _messages(self, topics: Collection[str] | None, start_ns: int | None) -> Iterator[Message]:
        stored = topics
        if topics is not None and self.coded:
            stored = {*topics, *(code for code, name in self.coded.items() if name in topics)}
        for path in self.files:
            with _whole_file(path) as stream:
                for message in stored_messages(stream, stored, start_ns):
                    name = self.coded.get(message.topic)
                    yield message if name is None else _decoded(message, name)


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
    if not path.is_dir():
        return _bag(path, [path], _metadata([path], {}, ''))
    if not (path / METADATA_FILE).is_file():
        if not any(path.glob('*.mcap')):
            raise BagError(f'{path}: holds no MCAP file: check the path')
        raise BagError(
            f'{path}: has no {METADATA_FILE}, so its recorder did not come to close it: '
            f'make a whole bag of it with `ftp-dent recover {path} --output NEW`'
        )
    written = read_metadata(path)
    # Before version 4 the names included the bag's own folder.
    files = [path / Path(file.path).name for file in written.files]
    topics = {(topic.name, topic.type): topic for topic in written.topics}
    found = _metadata(files, topics, written.ros_distro)
    return _bag(path, files, replace(found, custom_data=written.custom_data))


def read_messages(
    path: str | os.PathLike[str], topics: Collection[str] | None = None
) -> Iterator[Message]:
    """Messages of a bag, all or those of some topics, in the order of their reception."""
    return open_bag(path).messages(topics)


def topic_from(channel: Channel, schema: Schema | None) -> Topic:
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
    return Topic(
        name=channel.topic,
        type=schema.name if schema else '',
        type_hash=channel.metadata.get('topic_type_hash', ''),
        offered_qos=_offered_qos(channel),
        definition=Definition(schema.encoding, schema.data.decode()) if schema else Definition(),
    )


def _bag(path: Path, files: Sequence[Path], metadata: BagMetadata) -> Bag:
    if not any(topic.name.endswith(SUFFIXES) for topic in metadata.topics):
        return Bag(path, tuple(files), metadata)
    # Only this needs OpenCV and the library `rosbags`.
    from ftp_dent_ros.recording.compression import plain_topics

    coded, plain = plain_topics(metadata.topics)
    counts: dict[str, int] = defaultdict(int)
    for name, count in metadata.message_counts.items():
        counts[coded.get(name, name)] += count
    topics = {(topic.name, topic.type): topic for topic in plain}
    shown = replace(metadata, topics=tuple(topics.values()), message_counts=dict(counts))
    return Bag(path, tuple(files), shown, coded)


def _decoded(message: Message, name: str) -> Message:
    from ftp_dent_ros.recording.compression import decoded

    return decoded(message, name)


def _offered_qos(channel: Channel) -> tuple[Qos, ...]:
    """What nobody can read is as good as not told: only a replay asks for it."""
    text = channel.metadata.get('offered_qos_profiles', '')
    if len(text) > _LONGEST_QOS:
        return ()
    try:
        return qos_from(text)
    except Exception:  # YAML's own, and whatever stands in the fields' place
        return ()


def _metadata(
    files: Iterable[Path], topics: dict[tuple[str, str], Topic], distro: str
) -> BagMetadata:
    """Metadata of files; `topics` are preferred to what the files say of the same ones."""
    counts: dict[str, int] = defaultdict(int)
    found: dict[tuple[str, str], Topic] = {}
    described = []
    for path in files:
        with _whole_file(path) as stream:
            summary = summary_of(stream)
            if summary is None or summary.statistics is None:
                raise ValueError('it has no index')
            statistics = summary.statistics
            for channel in summary.channels.values():
                topic = topic_from(channel, summary.schemas.get(channel.schema_id))
                key = topic.name, topic.type
                preferred = topics.get(key, topic)
                found.setdefault(key, replace(preferred, definition=topic.definition))
                counts[topic.name] += statistics.channel_message_counts.get(channel.id, 0)
        described.append(
            BagFile(
                path=path.name,
                start_ns=statistics.message_start_time if statistics.message_count else NO_TIME_NS,
                duration_ns=statistics.message_end_time - statistics.message_start_time,
                message_count=statistics.message_count,
            )
        )
    return BagMetadata(tuple(described), tuple(found.values()), dict(counts), distro)


@contextmanager
def _whole_file(path: Path) -> Iterator[BinaryIO]:
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
        stream.seek(-len(MAGIC), os.SEEK_END)
        if stream.read() != MAGIC:
            raise _damaged(path, 'it has no end')
        stream.seek(0)
        try:
            yield stream
        except BagError as error:
            raise BagError(f'{path}: {error}') from None
        except Exception as reason:
            raise _damaged(path, reason) from None


def _damaged(path: Path, reason: object) -> BagError:
    bag = path.parent if (path.parent / METADATA_FILE).is_file() else path
    return BagError(
        f'{path}: not a whole MCAP file ({reason}): '
        f'make a whole bag of it with `ftp-dent recover {bag} --output NEW`'
    )
