"""Photographs of anything: a cloud of what is there or a refusal, and from noise never a point."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.simulation import Panel, Photometry, Renderer, Surface

sys.path.append(str(Path(__file__).resolve().parents[1]))
from any_photographs import KINDS, NOTHING, TRUE, any_photograph

EACH = 6
PATTERN = Pattern(320, 200, 8.0, 160.0)


def lens(focal: float) -> Lens:
    matrix = np.array([[focal, 0, 158.0], [0, focal, 98.0], [0, 0, 1]])
    return Lens(320, 200, matrix, np.zeros(5))


@pytest.fixture(scope='module')
def scene():
    turn = Rotation.from_euler('y', 0.3).as_matrix()
    rig = Rig(lens(450.0), lens(470.0), turn, np.array([-0.2, 0.005, 0.03]))
    surface = Surface((Panel(Pose.from_rpy((0.02, 0.03, 0), (0, 0, 0.65)), (-1, 1, -1, 1)),))
    light = Photometry(reference_distance=0.65)
    return rig, surface, Renderer(rig, PATTERN.draw(), light).render(surface)


@pytest.mark.parametrize('method', ['least-squares', 'virtual-reference'])
def test_anything_gives_a_cloud_of_what_is_there_or_a_reason(scene, method):
    rig, surface, base = scene
    reconstructor = Reconstructor(rig, PATTERN, Settings(method, stride=2))
    made_up, clouds, wrong = [], Counter(), []
    for index in range(EACH * len(KINDS)):
        photograph = any_photograph(index, base)
        try:
            cloud = reconstructor.measure(photograph.image).cloud
        except FtpDentError as reason:
            assert str(reason)
            continue
        if not cloud.valid.any():
            continue
        clouds[photograph.kind] += 1
        if photograph.holds == NOTHING:
            made_up.append((index, photograph.kind, int(cloud.valid.sum())))
        if photograph.holds == TRUE:
            error = np.abs(surface.distance(cloud.points[cloud.valid].astype(float)))
            # A point that says how far it may be off is not wrong by that.
            said = 4 * np.nan_to_num(cloud.sigma[cloud.valid])
            wrong.append((float((error > np.maximum(1e-3, said)).mean()), index, photograph.kind))
    assert made_up == []
    assert clouds['covered'] > EACH / 2, 'what is there is not measured any more'
    # The paper's method does not judge its points; the default does.
    if method == 'least-squares':
        assert sorted(wrong)[-1][0] < 0.05
