"""What a capture writes, and what is left of one that ended early."""

from __future__ import annotations

import resource

import numpy as np
import pytest

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.sequence import Sequence
from ftp_dent_ros.calibration.session import Session, find_poses
from ftp_dent_ros.cli.calibrate_capture import _keep, _seen_before
from ftp_dent_ros.cli.main import main
from ftp_dent_ros.errors import CalibrationError, ConfigurationError

SESSION = Session(Board(4, 3, 0.02), Sequence(320, 200))


def pose(level):
    rng = np.random.default_rng(level)
    return {
        frame: rng.integers(0, 255, (48, 64)).astype(np.uint8) for frame in SESSION.sequence.frames
    }


def test_a_full_disk_keeps_the_poses_before_and_leaves_nothing_half(tmp_path):
    _keep(tmp_path / 'pose_00', SESSION, pose(0))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(ConfigurationError, match=r'cannot be written .* --resume'):
            _keep(tmp_path / 'pose_01', SESSION, pose(1))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [each.name for each in tmp_path.iterdir()] == ['pose_00']
    assert list(find_poses(tmp_path)) == ['pose_00']


def test_a_rig_that_cannot_be_written_is_told_before_anything_is_read(tmp_path, capsys):
    words = ['--board', '4x3', '--square', '20', '--projector', '320x200']
    _keep(tmp_path / 'pose_00', SESSION, pose(0))
    taken = tmp_path / 'file'
    taken.write_text('')
    command = ['calibrate', 'solve', str(tmp_path), *words, '--output', str(taken / 'rig.yaml')]
    assert main(command) == 2
    assert 'rig.yaml: cannot be written' in capsys.readouterr().err


def test_what_was_being_written_is_no_pose(tmp_path):
    _keep(tmp_path / 'pose_00', SESSION, pose(0))
    _keep(tmp_path / 'pose_01', SESSION, pose(1))
    (tmp_path / 'pose_01').rename(tmp_path / '.pose_01')
    assert list(find_poses(tmp_path)) == ['pose_00']


def test_a_capture_goes_on_with_the_poses_there_are(tmp_path):
    assert _seen_before(tmp_path, SESSION) == ([], (0, 0), 0)
    _keep(tmp_path / 'pose_07', SESSION, pose(7))
    with pytest.raises(CalibrationError, match='none of 1 poses can be used'):
        _seen_before(tmp_path, SESSION)
