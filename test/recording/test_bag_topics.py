import pytest
import yaml
from bag_samples import POSE, pose_data

from ftp_dent_ros.errors import BagError, ConfigurationError
from ftp_dent_ros.recording.topic import (
    Qos,
    RecordedTopic,
    absolute_names,
    deserialise,
    is_hidden,
    known_topic,
    qos_from,
    qos_to_list,
)

LATCHED = Qos(durability='transient_local')


@pytest.mark.parametrize('profiles', [(), (Qos(),), (LATCHED, Qos(reliability='best_effort'))])
def test_qos_comes_back(profiles):
    assert qos_from(yaml.safe_dump(qos_to_list(profiles))) == profiles


def test_qos_of_older_bags_are_numbers():
    assert qos_from('[{reliability: 2, durability: 1}]') == (
        Qos('best_effort', 'transient_local'),
    )
    assert qos_from('') == ()


@pytest.mark.parametrize('text', ['[', '- {}', '!!int x', '- {reliability: [1]}', '7'])
def test_qos_that_cannot_be_read_offers_nothing(text):
    assert qos_from(text) == ()


def test_a_definition_of_another_version_is_none():
    topic = known_topic('/words', 'std_msgs/msg/String')
    assert topic.definition.startswith('string data')
    assert known_topic('/words', topic.type, announced=topic.type_hash) == topic
    assert known_topic('/words', topic.type, announced='RIHS01_of another').definition == ''
    assert known_topic('/ribs', 'wing_msgs/msg/Rib') == RecordedTopic('/ribs', 'wing_msgs/msg/Rib')


def test_deserialise_refuses_what_it_cannot_read():
    assert deserialise(pose_data(5), POSE).header.stamp.sec == 5
    with pytest.raises(BagError, match='wing_msgs/msg/Spar is unknown'):
        deserialise(b'\0\1\0\0', 'wing_msgs/msg/Spar')
    with pytest.raises(BagError, match='is no geometry_msgs/msg/PoseStamped'):
        deserialise(pose_data(5)[:20], POSE)


def test_names_are_made_absolute_and_some_are_hidden():
    names = absolute_names(['points', '/a/b', '/points'])
    assert names == ('/points', '/a/b')
    assert not any(map(is_hidden, names)) and is_hidden('/a/_action/status')


@pytest.mark.parametrize('name', ['a b', '', '/a//b', '/a/', '/1a', 'a-b'])
def test_what_no_topic_is_called_is_refused(name):
    with pytest.raises(ConfigurationError, match='is no name of a topic'):
        absolute_names([name])
