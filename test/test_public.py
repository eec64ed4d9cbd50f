"""The way in from Python."""

import subprocess
import sys

import numpy as np
import pytest

import ftp_dent_ros
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.evaluation.scenes import PATTERN, Scene, make_rig
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Dent, Panel, Photometry


def test_a_photograph_becomes_dents_in_two_calls():
    rig = make_rig(0.6, 0.23, (640, 360, 900.0), 1870.0)
    dent = Dent(0.0, 0.0, 0.05, 0.04, 0.001)
    panel = Panel(
        Pose.from_rpy((0.02, 0.03, 0), (0, 0, 0.6)), (-0.5, 0.5, -0.5, 0.5), dents=(dent,)
    )
    photograph = Scene(rig, (panel,), Photometry(reference_distance=0.6)).photograph()

    measured = ftp_dent_ros.reconstruct(photograph, rig, PATTERN, stride=2)
    (found,) = ftp_dent_ros.inspect(measured.cloud).dents

    assert measured.coverage.share > 0.95
    assert found.depth.value == pytest.approx(0.001, abs=2e-5)
    assert np.linalg.norm(found.position - [0, 0, 0.6]) < 1e-3


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(ConfigurationError, match=r'nowhere\.yaml'):
        ftp_dent_ros.reconstruct(np.zeros((2, 2, 3), np.uint8), 'nowhere.yaml', PATTERN)


def test_only_what_is_asked_for_is_loaded():
    code = (
        'import sys, ftp_dent_ros; assert "scipy" not in sys.modules and "cv2" not in sys.modules;'
        'ftp_dent_ros.inspect; assert "cv2" in sys.modules; assert not hasattr(ftp_dent_ros, "x")'
    )
    subprocess.run([sys.executable, '-c', code], check=True)
