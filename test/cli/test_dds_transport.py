from collections import namedtuple
from xml.etree import ElementTree

import pytest

from ftp_dent_ros import files
from ftp_dent_ros.ros import transport

MEGABYTE = 1 << 20


def text_of(path, name):
    tree = ElementTree.parse(path)
    return next(tree.iter(f'{{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}}{name}')).text


@pytest.fixture
def free(monkeypatch):
    def set_free(megabytes):
        status = namedtuple('Status', 'f_bavail f_frsize')(megabytes * 256, 4096)
        monkeypatch.setattr(transport.os, 'statvfs', lambda folder: status)

    return set_free


def test_the_shipped_profile_where_there_is_room(free):
    free(8 * 128 * 2)
    with transport.profile(8, environment={}) as variables:
        path = variables['FASTRTPS_DEFAULT_PROFILES_FILE']
    assert path == str(files.find('transport.xml'))
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


def test_nothing_without_shared_memory():
    with transport.profile(1, environment={}, shared_memory='/nowhere') as variables:
        assert variables == {}


def test_what_the_user_has_set_stays():
    theirs = {'FASTRTPS_DEFAULT_PROFILES_FILE': '/my/profile.xml'}
    with transport.profile(1, environment=theirs) as variables:
        assert variables == {}
