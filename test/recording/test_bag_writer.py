import yaml
from bag_samples import (
    POSE,
    START_NS,
    STRING,
    WORDS,
    sample_messages,
    write_sample,
)
from mcap.reader import NonSeekingReader, SeekingReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader

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
        assert connections['/words'].msgdef.data == WORDS.definition
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
