import errno

import pytest

from ftp_dent_ros.errors import ConfigurationError, printable
from ftp_dent_ros.files import (
    check_writable,
    config_folder,
    find,
    nearest_folder,
    write_atomically,
)


def test_a_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / 'new' / 'result.txt'
    with pytest.raises(RuntimeError), write_atomically(path) as temporary:
        temporary.write_text('half')
        raise RuntimeError
    assert list(path.parent.iterdir()) == []
    with write_atomically(path) as temporary:
        temporary.write_text('whole')
        assert not path.exists()
    assert path.read_text() == 'whole'
    assert list(path.parent.iterdir()) == [path]


def test_a_full_disk_is_told_with_the_name_that_was_given(tmp_path):
    full = OSError(errno.ENOSPC, 'No space left on device')
    with pytest.raises(OSError, match='No space') as told, write_atomically(tmp_path / 'a.txt'):
        raise full
    assert told.value.filename == str(tmp_path / 'a.txt')


def test_what_cannot_be_written_is_told_before_and_nothing_is_made(tmp_path):
    (tmp_path / 'file').write_text('mine')
    for path in (tmp_path, tmp_path / 'file/cloud.ply', '/proc/cloud.ply'):
        with pytest.raises(ConfigurationError, match=r'cannot be written .*: give another place'):
            check_writable(path)
    check_writable(tmp_path / 'new/folder/cloud.ply')
    assert nearest_folder(tmp_path / 'new/folder/cloud.ply') == tmp_path
    assert [path.name for path in tmp_path.iterdir()] == ['file']


def test_a_shipped_file_is_found_by_its_prefix_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find('shipped:rig.yaml') == config_folder() / 'rig.yaml'
    with pytest.raises(ConfigurationError, match=r'or give shipped:rig\.yaml for the example'):
        find('rig.yaml')
    (tmp_path / 'rig.yaml').write_text('mine')
    assert find('rig.yaml').read_text() == 'mine'


@pytest.mark.parametrize('name', ['nothing.yaml', '../setup.py', '', 'rig'])
def test_what_is_not_shipped_is_told(name):
    with pytest.raises(ConfigurationError, match=r'no file of that name is shipped: .*rig\.yaml'):
        find(f'shipped:{name}')


def test_what_a_terminal_would_obey_is_shown_instead():
    assert printable('größe 3 µm') == 'größe 3 µm'
    assert printable('a\x1b[2J\r\n\u202eb\udc80') == 'a\\x1b[2J\\r\\n\\u202eb\\udc80'
    assert len(printable('x' * 10_000)) < 2100
    assert '\x1b' not in str(ConfigurationError('\x1b]0;title\x07'))
