import io
import resource
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest
import yaml
from bag_samples import (
    POSE,
    POSES,
    SILENT,
    START_NS,
    STRING,
    WORDS,
    sample_messages,
    string_data,
    write_sample,
)
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Footer, MessageIndex, MetadataIndex, SummaryOffset
from mcap.stream_reader import StreamReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.mcap_file import CHUNK_SIZE
from ftp_dent_ros.recording.reader import open_bag, read_messages
from ftp_dent_ros.recording.recovery import recover
from ftp_dent_ros.recording.salvage import Salvage
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagWriter

STRING_HASH = 'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
INFINITE = {'sec': 9223372036, 'nsec': 854775807}


def offered(reliability, durability):
    return {
        'history': 'unknown',
        'depth': 0,
        'reliability': reliability,
        'durability': durability,
        'deadline': INFINITE,
        'lifespan': INFINITE,
        'liveliness': 'automatic',
        'liveliness_lease_duration': INFINITE,
        'avoid_ros_namespace_conventions': False,
    }


def test_metadata_has_the_fields_of_rosbag2_in_jazzy(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_DISTRO', 'jazzy')
    write_sample(tmp_path / 'bag', sample_messages(7))
    text = (tmp_path / 'bag' / 'metadata.yaml').read_text()
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    topics = information.pop('topics_with_message_count')
    assert information == {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': 60_000_000},
        'starting_time': {'nanoseconds_since_epoch': START_NS},
        'message_count': 7,
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': ['bag_0.mcap'],
        'files': [
            {
                'path': 'bag_0.mcap',
                'starting_time': {'nanoseconds_since_epoch': START_NS},
                'duration': {'nanoseconds': 60_000_000},
                'message_count': 7,
            }
        ],
        'custom_data': None,
        'ros_distro': 'jazzy',
    }
    assert [topic['message_count'] for topic in topics] == [4, 3, 0]
    assert topics[0]['topic_metadata'] == {
        'name': '/words',
        'type': STRING,
        'serialization_format': 'cdr',
        'offered_qos_profiles': [
            offered('reliable', 'volatile'),
            offered('reliable', 'transient_local'),
        ],
        'type_description_hash': STRING_HASH,
    }
    # yaml-cpp has no trouble with anchors, but rosbag2 writes none.
    assert '&' not in text


def test_an_independent_reader_opens_the_bag(tmp_path):
    messages = sample_messages(50)
    write_sample(tmp_path / 'bag', messages)
    with Reader(tmp_path / 'bag') as reader:
        connections = {connection.topic: connection for connection in reader.connections}
        assert set(connections) == {'/words', '/poses', '/silent'}
        assert connections['/words'].digest == STRING_HASH
        assert connections['/words'].msgdef.data == WORDS.definition.text
        qos = connections['/words'].ext.offered_qos_profiles[1]
        assert qos.durability == QosDurability.TRANSIENT_LOCAL
        (qos,) = connections['/poses'].ext.offered_qos_profiles
        assert qos.reliability == QosReliability.BEST_EFFORT
        assert reader.message_count == 50
        read = [(each.topic, time_ns, bytes(data)) for each, time_ns, data in reader.messages()]
    assert read == [(each.topic, each.log_time_ns, each.data) for each in messages]


def test_the_file_alone_says_all_that_rosbag2_asks_it(tmp_path):
    write_sample(tmp_path / 'bag', sample_messages(10))
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        reader = SeekingReader(stream, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        (record,) = reader.iter_metadata()
        assert len(list(reader.iter_messages())) == 10
        stream.seek(0)
        assert len(list(NonSeekingReader(stream, validate_crcs=True).iter_messages())) == 10
    channels = {channel.topic: channel for channel in summary.channels.values()}
    assert channels['/words'].message_encoding == 'cdr'
    assert channels['/words'].metadata['topic_type_hash'] == STRING_HASH
    profiles = yaml.safe_load(channels['/words'].metadata['offered_qos_profiles'])
    assert profiles[0] == offered('reliable', 'volatile')
    assert {schema.encoding for schema in summary.schemas.values()} == {'ros2msg'}
    assert {schema.name for schema in summary.schemas.values()} == {STRING, POSE}
    assert record.name == 'rosbag2'
    serialized = yaml.safe_load(record.metadata['serialized_metadata'])
    assert (serialized['version'], serialized['message_count']) == (9, 10)
    statistics = summary.statistics
    assert (statistics.message_count, statistics.channel_count) == (10, 3)
    # An index of each message, by which rosbag2 sorts by time.
    assert [len(each.message_index_offsets) for each in summary.chunk_indexes] == [2, 2, 2, 1]
    assert all(each.message_index_length for each in summary.chunk_indexes)


def record_at(data: bytes, offset: int) -> tuple[int, bytes]:
    """Opcode and body of the record at an offset."""
    opcode, length = struct.unpack_from('<BQ', data, offset)
    return opcode, data[offset + 9 : offset + 9 + length]


def test_every_index_points_at_what_it_names(tmp_path):
    messages = sample_messages(20)
    write_sample(tmp_path / 'bag', messages, each=7)
    data = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        reader = SeekingReader(stream)
        summary = reader.get_summary()
        stream.seek(0)
        records = list(StreamReader(stream, emit_chunks=True).records)
    times = []
    for chunk in summary.chunk_indexes:
        assert data[chunk.chunk_start_offset] == Opcode.CHUNK
        end = chunk.chunk_start_offset + chunk.chunk_length
        content = data[end - chunk.compressed_size : end]
        assert min(chunk.message_index_offsets.values()) == end
        index_size = 0
        for channel, offset in chunk.message_index_offsets.items():
            opcode, body = record_at(data, offset)
            index = MessageIndex.read(ReadDataStream(io.BytesIO(body)))
            assert (opcode, index.channel_id) == (Opcode.MESSAGE_INDEX, channel)
            index_size += 9 + len(body)
            for time_ns, place in index.records:
                opcode, body = record_at(content, place)
                assert opcode == Opcode.MESSAGE
                assert struct.unpack_from('<HIQ', body)[::2] == (channel, time_ns)
                times.append(time_ns)
        assert index_size == chunk.message_index_length
    assert sorted(times) == [message.log_time_ns for message in messages]

    (footer,) = (record for record in records if isinstance(record, Footer))
    offsets = [record for record in records if isinstance(record, SummaryOffset)]
    assert len(offsets) == 5
    position = footer.summary_start
    for group in offsets:
        assert group.group_start == position
        assert data[position] == group.group_opcode
        position += group.group_length
    assert position == footer.summary_offset_start
    (metadata,) = (record for record in records if isinstance(record, MetadataIndex))
    opcode, body = record_at(data, metadata.offset)
    assert (opcode, len(body) + 9) == (Opcode.METADATA, metadata.length)


def test_messages_are_gathered_into_chunks(tmp_path):
    data = string_data('x' * 300_000)
    messages = [Message('/words', STRING, START_NS + index, 0, data) for index in range(30)]
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(WORDS)
        for message in messages:
            writer.write([message])
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        chunks = SeekingReader(stream).get_summary().chunk_indexes
    assert [chunk.uncompressed_size // len(data) for chunk in chunks] == [14, 14, 2]
    assert all(chunk.uncompressed_size < CHUNK_SIZE + 2 * len(data) for chunk in chunks)
    assert list(read_messages(tmp_path / 'bag')) == messages


def test_an_open_chunk_cut_at_any_byte_gives_back_every_whole_message(tmp_path):
    messages = sample_messages(8)
    with BagWriter(tmp_path / 'bag') as writer:
        for known in (WORDS, POSES, SILENT):
            writer.add_topic(known)
        writer.write(messages[:2])
        writer.sync()
        writer.write(messages[2:5])
        writer.write(messages[5:])
        data = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    ends = [data.index(message.data) + len(message.data) for message in messages]
    cuts = {*range(8, len(data), 97), *range(ends[1] - 9, ends[3] + 9), len(data)}
    for cut in sorted(cuts):
        (tmp_path / 'cut.mcap').write_bytes(data[:cut])
        salvage = Salvage(tmp_path / 'cut.mcap')
        found = list(salvage.messages())
        assert found == messages[: len([end for end in ends if end <= cut])], cut
        assert not salvage.whole and salvage.damaged == 0
    assert salvage.cut == 0


def test_the_memory_does_not_grow_with_the_recording(tmp_path):
    data = string_data('x' * 1000)
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(WORDS)
        sizes = []
        tracemalloc.start()
        for second in range(0, 1200, 2):  # ten messages a second, a chunk every two
            start_ns = START_NS + second * 1_000_000_000
            writer.write([Message('/words', STRING, start_ns + k, 0, data) for k in range(20)])
            writer._file.end_chunk()
            if second in (600, 1198):
                sizes.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    # What remains is the index: 100 bytes or so a chunk, and room for it to grow.
    assert sizes[1] - sizes[0] < 300 * 200 + 50_000


def test_files_are_split_by_size(tmp_path):
    messages = sample_messages(300)
    write_sample(tmp_path / 'bag', messages, max_file_size=20_000)
    bag = open_bag(tmp_path / 'bag')
    assert len(bag.files) > 3
    assert [path.name for path in bag.files] == [f'bag_{i}.mcap' for i in range(len(bag.files))]
    assert all(20_000 <= path.stat().st_size < 40_000 for path in bag.files[:-1])
    assert list(bag.messages()) == messages
    with Reader(tmp_path / 'bag') as reader:
        assert len(list(reader.messages())) == 300
    parts = [message for path in bag.files for message in read_messages(path)]
    assert parts == messages


@pytest.mark.parametrize('handed_over', [(10,), (1,) * 10, (1, 2, 7), (3, 7), (9, 1)])
def test_a_file_ends_with_the_message_that_fills_it(tmp_path, handed_over):
    data = string_data('x' * 3000)
    with BagWriter(tmp_path / 'bag', max_file_size=10_240) as writer:
        writer.add_topic(WORDS)
        for count in handed_over:
            writer.write([Message('/words', STRING, START_NS, 0, data)] * count)
    counts = [file.message_count for file in open_bag(tmp_path / 'bag').metadata.files]
    assert counts == [4, 4, 2]


def test_a_bag_without_messages_is_a_bag(tmp_path):
    write_sample(tmp_path / 'bag', [])
    bag = open_bag(tmp_path / 'bag')
    assert bag.metadata.message_counts == {'/words': 0, '/poses': 0, '/silent': 0}
    assert list(bag.messages()) == []
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 0


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'bag_0.mcap').write_text('mine')
    with pytest.raises(BagError, match='exists already and is not overwritten'):
        BagWriter(tmp_path / 'bag')
    assert (tmp_path / 'bag' / 'bag_0.mcap').read_text() == 'mine'


def test_output_that_cannot_be_made(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(BagError, match='cannot be written'):
        BagWriter(tmp_path / 'file' / 'bag')


def test_there_is_no_metadata_before_the_end(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(WORDS)
        writer.write(sample_messages(1))
        assert [path.name for path in (tmp_path / 'bag').iterdir()] == ['bag_0.mcap']
    assert (tmp_path / 'bag' / 'metadata.yaml').is_file()


def test_what_write_returned_from_is_in_the_file(tmp_path):
    writer = BagWriter(tmp_path / 'bag')
    for known in (WORDS, POSES, SILENT):
        writer.add_topic(known)
    messages = sample_messages(5)
    for count, message in enumerate(messages, 1):
        writer.write([message])
        recover(tmp_path / 'bag', tmp_path / f'new{count}')
        assert list(read_messages(tmp_path / f'new{count}')) == messages[:count]
        assert writer.size == (tmp_path / 'bag' / 'bag_0.mcap').stat().st_size
    writer.close()


FILL = """
import sys
import tracemalloc
from pathlib import Path
sys.path[:0] = sys.argv[3:]
from bag_samples import POSES, SILENT, START_NS, STRING, WORDS, string_data
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.mcap_file import CHUNK_SIZE
from ftp_dent_ros.recording.salvage import Salvage
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagWriter

writer = BagWriter(Path(sys.argv[1]))
for known in (WORDS, POSES, SILENT):
    writer.add_topic(known)
count = 0
try:
    while count < 1_000_000:
        data = string_data(f'{count:7d}' + 'x' * int(sys.argv[2]))
        writer.write([Message('/words', STRING, START_NS + count, START_NS + count, data)])
        count += 1
except BagError as error:
    print(error)
print(count)
try:
    writer.close()
    print('closed')
except BagError as error:
    print(f'not closed: {error}')
"""


def fill(bag: Path, size: int, file_limit: int = resource.RLIM_INFINITY) -> list[str]:
    """Write messages of a size until the disk is full, in a process of its own."""
    here = Path(__file__).resolve()
    result = subprocess.run(
        [sys.executable, '-c', FILL, str(bag), str(size), str(here.parent), str(here.parents[2])],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit)),
        capture_output=True,
        text=True,
        check=True,
    )
    return result.stdout.splitlines()


@pytest.mark.parametrize('size', [10, 3000, 300_000])
def test_a_full_disk_leaves_a_whole_bag_of_what_was_written(small_disk, size):
    error, count, end = fill(small_disk / 'bag', size)
    assert error == f'{small_disk / "bag"}: the disk is full: free some space'
    assert end == 'closed'
    messages = list(read_messages(small_disk / 'bag'))
    assert [int(message.data[8:15]) for message in messages] == list(range(int(count)))
    assert len(messages) * max(size, 100) > 200_000
    with Reader(small_disk / 'bag') as reader:
        assert reader.message_count == int(count)


@pytest.mark.parametrize('size', [10, 3000, 90_000])
def test_a_limit_to_the_file_size_leaves_whole_messages(tmp_path, size):
    error, count, end = fill(tmp_path / 'bag', size, file_limit=300_000)
    assert 'has grown to the limit of its file system or user' in error
    assert '--max-bag-size' in error
    # There may be no room left for the index; the messages are there.
    if end == 'closed':
        assert len(list(read_messages(tmp_path / 'bag'))) == int(count)
    else:
        assert not (tmp_path / 'bag' / 'metadata.yaml').exists()
    recovery = recover(tmp_path / 'bag', tmp_path / 'new')
    assert recovery.message_counts['/words'] == int(count)
    assert recovery.cut == {}
    numbers = [int(message.data[8:15]) for message in read_messages(tmp_path / 'new')]
    assert numbers == list(range(int(count)))
