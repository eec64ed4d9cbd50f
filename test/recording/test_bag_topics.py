import pytest
import yaml
from bag_samples import POSE, pose_data

from ftp_dent_ros.errors import BagError, ConfigurationError
from ftp_dent_ros.recording.definitions import deserialise, find_definition, type_hash
from ftp_dent_ros.recording.selection import Selection
from ftp_dent_ros.recording.topic import Definition, Qos, qos_from, qos_to_list, qos_to_yaml

LATCHED = Qos(durability='transient_local', deadline=1_500_000_000, liveliness='manual_by_topic')


def test_qos_is_written_as_rosbag2_does_in_version_9():
    assert qos_to_list([LATCHED]) == [
        {
            'history': 'unknown',
            'depth': 0,
            'reliability': 'reliable',
            'durability': 'transient_local',
            'deadline': {'sec': 1, 'nsec': 500000000},
            'lifespan': {'sec': 9223372036, 'nsec': 854775807},
            'liveliness': 'manual_by_topic',
            'liveliness_lease_duration': {'sec': 9223372036, 'nsec': 854775807},
            'avoid_ros_namespace_conventions': False,
        }
    ]


@pytest.mark.parametrize('profiles', [(), (Qos(),), (LATCHED, Qos(reliability='best_effort'))])
def test_qos_comes_back(profiles):
    assert qos_from(qos_to_yaml(profiles)) == profiles
    assert qos_from(qos_to_list(profiles)) == profiles


def test_qos_of_older_bags_are_numbers_in_text():
    text = yaml.safe_dump(
        [
            {
                'history': 1,
                'depth': 7,
                'reliability': 2,
                'durability': 1,
                # Foxy's infinity, larger than rmw's.
                'deadline': {'sec': 9223372036, 'nsec': 4294967295},
                'lifespan': {'sec': 0, 'nsec': 5},
                'liveliness': 3,
                'liveliness_lease_duration': {'sec': 2147483647, 'nsec': 4294967295},
                'avoid_ros_namespace_conventions': False,
            }
        ]
    )
    (qos,) = qos_from(text)
    assert (qos.history, qos.depth) == ('keep_last', 7)
    assert (qos.reliability, qos.durability) == ('best_effort', 'transient_local')
    assert (qos.liveliness, qos.lifespan) == ('manual_by_topic', 5)
    assert qos.deadline == Qos().deadline
    assert qos_from('') == ()


def test_known_definition_is_text_with_all_that_it_contains():
    definition = find_definition('sensor_msgs/msg/Image')
    assert definition.encoding == 'ros2msg'
    assert definition.text.startswith('std_msgs/Header header\n')
    parts = definition.text.split('=' * 80 + '\n')
    assert [part.splitlines()[0] for part in parts[1:]] == [
        'MSG: std_msgs/Header',
        'MSG: builtin_interfaces/Time',
    ]


def test_unknown_definition_is_looked_up_in_the_sourced_workspaces(tmp_path, monkeypatch):
    folder = tmp_path / 'share' / 'wing_msgs' / 'msg'
    folder.mkdir(parents=True)
    (folder / 'Rib.msg').write_text(
        '# one rib\nstd_msgs/Header header\nNut[] nuts\nuint8 SMALL=1\n'
    )
    (folder / 'Nut.msg').write_text('float64 torque\nstring<=8 label "x"\n')
    header = tmp_path / 'share' / 'std_msgs' / 'msg'
    header.mkdir(parents=True)
    (header / 'Header.msg').write_text('builtin_interfaces/Time stamp\nstring frame_id\n')
    time = tmp_path / 'share' / 'builtin_interfaces' / 'msg'
    time.mkdir(parents=True)
    (time / 'Time.msg').write_text('int32 sec\nuint32 nanosec\n')
    assert find_definition('wing_msgs/msg/Rib') == Definition()

    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{tmp_path}')
    definition = find_definition('wing_msgs/msg/Rib')
    assert definition.encoding == 'ros2msg'
    names = [line for line in definition.text.splitlines() if line.startswith('MSG: ')]
    assert names == ['MSG: std_msgs/Header', 'MSG: wing_msgs/Nut', 'MSG: builtin_interfaces/Time']
    assert type_hash('wing_msgs/msg/Rib') == ''

    data = bytes.fromhex('00010000 07000000 09000000 04000000') + b'rib\0' + bytes(4)
    rib = deserialise(data, 'wing_msgs/msg/Rib', definition)
    assert (rib.header.stamp.sec, rib.header.frame_id, list(rib.nuts)) == (7, 'rib', [])


def test_definition_of_another_version_of_a_type_is_not_guessed():
    assert find_definition(POSE, 'RIHS01_' + '0' * 64) == Definition()


def test_deserialise_refuses_what_it_cannot_read():
    assert deserialise(pose_data(5), POSE).header.stamp.sec == 5
    with pytest.raises(BagError, match='wing_msgs/msg/Spar is unknown'):
        deserialise(b'\0\1\0\0', 'wing_msgs/msg/Spar')
    with pytest.raises(BagError, match='is no geometry_msgs/msg/PoseStamped'):
        deserialise(pose_data(5)[:20], POSE)


def test_selection_by_name_expression_and_exclusion():
    named = Selection.of(['points', '/a/b', '/_hidden'])
    assert [named.wants(name) for name in ('/points', '/a/b', '/_hidden', '/c')] == [
        True,
        True,
        True,
        False,
    ]
    every = Selection.of([], everything=True, exclude_regex='image')
    assert every.wants('/points')
    assert not every.wants('/camera/image_raw')
    assert not every.wants('/a/_action/status')
    some = Selection.of([], regex='^/camera/', exclude_regex='info$')
    assert some.wants('/camera/image_raw')
    assert not some.wants('/camera/camera_info')
    assert not some.wants('/points')
    assert not Selection().wants('/points')


@pytest.mark.parametrize('name', ['a b', '', '/a//b', '/a/', '/1a', 'a-b'])
def test_selection_refuses_what_no_topic_is_called(name):
    with pytest.raises(ConfigurationError, match='is no name of a topic'):
        Selection.of([name])


def test_selection_refuses_a_malformed_expression():
    with pytest.raises(ConfigurationError, match='is no regular expression'):
        Selection.of([], regex='(')
