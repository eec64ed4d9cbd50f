from collections import namedtuple
from pathlib import Path
from xml.etree import ElementTree

import pytest

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.supervision import shared_memory, transport

MEGABYTE = 1 << 20


def text_of(path, name):
    tree = ElementTree.parse(path)
    return next(tree.iter(f'{{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}}{name}')).text


@pytest.fixture
def free(monkeypatch):
    def set_free(megabytes):
        status = namedtuple('Status', 'f_bavail f_frsize')(megabytes * 256, 4096)
        monkeypatch.setattr(shared_memory.os, 'statvfs', lambda folder: status)

    return set_free


def test_the_shipped_profile_where_there_is_room(free):
    free(8 * 128 * 2)
    with transport.profile(8, environment={}) as variables:
        path = variables['FASTRTPS_DEFAULT_PROFILES_FILE']
    assert path == str(files.find('shipped:transport.xml'))
    assert text_of(path, 'segment_size') == str(128 * MEGABYTE)


def test_smaller_segments_where_there_is_not(free):
    free(8 * 128 * 2 - 1)
    with transport.profile(8, environment={}) as variables:
        path = variables['FASTRTPS_DEFAULT_PROFILES_FILE']
        assert text_of(path, 'segment_size') == str(64 * MEGABYTE)
        assert text_of(path, 'maxMessageSize') == str(16 * MEGABYTE)
        assert text_of(path, 'useBuiltinTransports') == 'false'


def test_a_message_is_never_larger_than_a_segment(free):
    free(64)
    with transport.profile(8, environment={}) as variables:
        path = variables['FASTRTPS_DEFAULT_PROFILES_FILE']
        assert text_of(path, 'segment_size') == str(4 * MEGABYTE)
        assert text_of(path, 'maxMessageSize') == str(2 * MEGABYTE)


def test_nothing_where_there_is_hardly_any_room(free):
    free(63)
    with transport.profile(8, environment={}) as variables:
        assert variables == {}


def test_without_room_a_confined_profile_says_nothing_of_segments(free):
    free(63)
    with transport.profile(8, 'lo', environment={}) as variables:
        path = variables['FASTRTPS_DEFAULT_PROFILES_FILE']
        for name in ('segment_size', 'maxMessageSize', 'port_queue_capacity'):
            with pytest.raises(StopIteration):
                text_of(path, name)


def test_nothing_without_shared_memory():
    with transport.profile(1, environment={}, shared_memory='/nowhere') as variables:
        assert variables == {}


def test_what_the_user_has_set_stays():
    theirs = {'FASTRTPS_DEFAULT_PROFILES_FILE': '/my/profile.xml'}
    with transport.profile(1, environment=theirs) as variables:
        assert variables == {}


def addresses_in(variables):
    tree = ElementTree.parse(variables['FASTRTPS_DEFAULT_PROFILES_FILE'])
    name = '{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}address'
    return [element.text for element in tree.iter(name)]


@pytest.mark.parametrize(
    ('interface', 'environment'),
    [
        ('lo', {}),
        ('127.0.0.1', {}),
        ('', {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}),
        ('', {'ROS_LOCALHOST_ONLY': '1'}),
    ],
)
def test_one_interface_alone(free, interface, environment):
    free(8 * 128 * 2)
    with transport.profile(8, interface, environment=environment) as variables:
        assert addresses_in(variables) == ['127.0.0.1']
        assert variables['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SUBNET'


def test_without_room_it_is_confined_all_the_same(free):
    free(1)
    with transport.profile(8, 'lo', environment={}) as variables:
        assert addresses_in(variables) == ['127.0.0.1']
        path = Path(variables['FASTRTPS_DEFAULT_PROFILES_FILE'])
        assert 'segment_size' not in path.read_text()


@pytest.mark.parametrize('interface', ['none0', '203.0.113.7', 'a' * 40])
def test_an_interface_that_is_not_here(interface):
    with (
        pytest.raises(ConfigurationError, match='no interface of this computer'),
        transport.profile(1, interface, environment={}),
    ):
        pass
