from pathlib import Path

import pytest
from bag_samples import (
    START_NS,
    STRING,
    WORDS,
    sample_messages,
    write_sample,
)
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.recording.topic import Message, typestore


def write_foreign(path: Path, messages: list[Message], **options) -> None:
    """A file as the library `mcap` writes it."""
    with path.open('wb') as stream:
        writer = McapWriter(stream, **options)
        writer.start('ros2')
        text = WORDS.definition.encode()
        schema = writer.register_schema(name=STRING, encoding='ros2msg', data=text)
        channel = writer.register_channel('/words', 'cdr', schema)
        for message in messages:
            writer.add_message(
                channel,
                log_time=message.log_time_ns,
                data=message.data,
                publish_time=message.publish_time_ns,
                sequence=message.sequence,
            )
        writer.finish()


def words(count: int) -> list[Message]:
    return [message for message in sample_messages(2 * count) if message.topic == '/words']


@pytest.fixture
def bag(tmp_path) -> Path:
    write_sample(tmp_path / 'bag', sample_messages(20))
    return tmp_path / 'bag'


def test_everything_comes_back(bag):
    assert list(open_bag(bag).messages()) == sample_messages(20)
    assert list(open_bag(bag / 'bag_0.mcap').messages()) == sample_messages(20)
    opened = open_bag(bag)
    assert opened.topics == open_bag(bag / 'bag_0.mcap').topics
    assert opened.topics[0] == WORDS
    assert opened.message_counts == {'/words': 10, '/poses': 10, '/silent': 0}
    assert opened.start_ns == START_NS


def test_topics_are_chosen(bag):
    opened = open_bag(bag)
    poses = list(opened.messages(['/poses']))
    assert [message.topic for message in poses] == ['/poses'] * 10
    assert list(opened.messages([])) == []


def test_messages_are_ordered_by_the_time_of_reception(tmp_path):
    messages = sample_messages(20)
    late = [*messages[10:], *messages[:10]]
    write_sample(tmp_path / 'bag', late, each=4)
    assert list(open_bag(tmp_path / 'bag').messages()) == messages


@pytest.mark.parametrize(
    'options',
    [
        {'compression': CompressionType.ZSTD, 'chunk_size': 300},
        {'compression': CompressionType.LZ4},
        {'use_chunking': False},
    ],
)
def test_files_of_other_writers(tmp_path, options):
    path = tmp_path / 'other.mcap'
    write_foreign(path, words(10), **options)
    opened = open_bag(path)
    assert opened.message_counts == {'/words': 10}
    assert list(opened.messages()) == words(10)


@pytest.mark.parametrize('version', [8, 9])
def test_bags_of_another_recorder(tmp_path, version):
    with RosbagsWriter(
        tmp_path / 'bag', version=version, storage_plugin=StoragePlugin.MCAP
    ) as writer:
        connection = writer.add_connection('/words', STRING, typestore=typestore())
        for message in words(5):
            writer.write(connection, message.log_time_ns, message.data)
    opened = open_bag(tmp_path / 'bag')
    (topic,) = opened.topics
    assert (topic.name, topic.type) == ('/words', STRING)
    read = [(message.log_time_ns, message.data) for message in opened.messages()]
    assert read == [(message.log_time_ns, message.data) for message in words(5)]


def test_a_bag_that_is_not_whole_is_refused_with_advice(tmp_path, bag):
    (bag / 'metadata.yaml').unlink()
    with pytest.raises(BagError, match=f'`ftp-dent recover {bag} --output NEW`'):
        open_bag(bag)
    data = (bag / 'bag_0.mcap').read_bytes()
    for size in (len(data) - 1, len(data) // 2, 100, 9):
        (tmp_path / 'cut.mcap').write_bytes(data[:size])
        with pytest.raises(BagError, match=r'not a whole MCAP file .* `ftp-dent recover'):
            open_bag(tmp_path / 'cut.mcap')


def test_damaged_data_are_not_handed_out(bag):
    path = bag / 'bag_0.mcap'
    data = bytearray(path.read_bytes())
    data[data.index(b'   6xxxxxx') + 5] ^= 1
    path.write_bytes(data)
    opened = open_bag(bag)
    with pytest.raises(BagError, match='`ftp-dent recover'):
        list(opened.messages())


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('storage_identifier: mcap', 'storage_identifier: sqlite3', 'ros2 bag convert'),
        ("compression_mode: ''", 'compression_mode: FILE', 'ros2 bag convert'),
        ('rosbag2_bagfile_information:', 'information:', 'not a rosbag2 metadata file'),
        ('version: 9', 'version: [9', 'not valid YAML'),
    ],
)
def test_metadata_that_is_not_understood(bag, old, new, sentence):
    path = bag / 'metadata.yaml'
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(BagError, match=sentence):
        open_bag(bag)


def test_a_file_of_other_messages_is_refused(tmp_path):
    with (tmp_path / 'x.mcap').open('wb') as stream:
        writer = McapWriter(stream)
        writer.start()
        channel = writer.register_channel('/words', 'json', 0)
        writer.add_message(channel, log_time=1, data=b'{}', publish_time=1)
        writer.finish()
    with pytest.raises(BagError, match="json messages, not ROS 2's cdr"):
        open_bag(tmp_path / 'x.mcap')
