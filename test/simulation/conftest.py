"""A small rig, a pattern for it and a photometry without noise."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.simulation import Photometry


@pytest.fixture(scope='session')
def rig():
    """Both lenses distorted, 0.2 m apart, crossing 0.6 m ahead; the camera has 96 x 64 pixels."""
    camera = Lens(
        96,
        64,
        np.array([[900.0, 0, 46.3], [0, 904.0, 32.9], [0, 0, 1]]),
        np.array([-1.2, 5.0, 0.01, -0.008, 0.4]),
    )
    projector = Lens(
        160,
        100,
        np.array([[800.0, 0, 80.4], [0, 805.0, 48.2], [0, 0, 1]]),
        np.array([-0.6, 1.0, -0.007, 0.009, 0.0]),
    )
    turn = Rotation.from_euler('xyz', [0.02, 0.32, -0.01]).as_matrix()
    return Rig(camera, projector, turn, np.array([-0.2, 0.006, 0.03]))


@pytest.fixture(scope='session')
def pattern():
    return Pattern(160, 100, 8.0, 80.0)


@pytest.fixture(scope='session')
def noiseless():
    """Light and sensor as they are by default, without noise and camera blur."""
    return Photometry(reference_distance=0.6, psf_px=0.0, full_well=1e15, read_noise=0.0)
