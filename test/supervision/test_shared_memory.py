"""Leftovers are told from what a living process owns."""

import fcntl
import os

from ftp_dent_ros.supervision.shared_memory import Freed, free_leftovers

OURS, THEIRS = 'fastrtps_0123456789abcdef', 'fastrtps_fedcba9876543210'


def make(folder, stem, size=1000):
    for name, content in ((stem, bytes(size)), (f'{stem}_el', b''), (f'sem.{stem}_mutex', b'')):
        (folder / name).write_bytes(content)
        os.utime(folder / name, (0, 0))


def test_what_nobody_has_locked_is_freed_and_the_rest_stays(tmp_path):
    make(tmp_path, OURS)
    make(tmp_path, THEIRS)
    make(tmp_path, 'fastrtps_port7413', 500)
    others = ['psm_data', 'fastrtps_notes.txt', 'fastrtps_0123456789abcdef.bak', 'sem.mine']
    for name in others:
        (tmp_path / name).write_text('mine')
    with (tmp_path / f'{THEIRS}_el').open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert free_leftovers(tmp_path) == Freed(segments=1, bytes=1500)
        kept = {THEIRS, f'{THEIRS}_el', f'sem.{THEIRS}_mutex'}
        assert set(os.listdir(tmp_path)) == {*others, *kept}


def test_a_port_that_one_of_several_has_open_stays(tmp_path):
    make(tmp_path, 'fastrtps_port7400')
    (tmp_path / 'fastrtps_port7400_sl').touch()
    os.utime(tmp_path / 'fastrtps_port7400_sl', (0, 0))
    with (tmp_path / 'fastrtps_port7400_sl').open() as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)
        assert free_leftovers(tmp_path) == Freed(0, 0)
    assert (tmp_path / 'fastrtps_port7400').exists()


def test_what_is_just_being_made_stays(tmp_path):
    make(tmp_path, OURS)
    (tmp_path / f'{OURS}_el').touch()
    assert free_leftovers(tmp_path) == Freed(0, 0)
    assert (tmp_path / OURS).exists()


def test_nothing_where_there_is_no_shared_memory(tmp_path):
    assert free_leftovers(tmp_path / 'none') == Freed(0, 0)
