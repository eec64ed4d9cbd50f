"""Photographs that are the wrong way round, of skin that shows no rim of the projector's frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_scenes import PATTERN, RIG, Scene, panel

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.profilometry import Reconstructor, Settings


@pytest.fixture(scope='module', params=['flat', 'bent'])
def unframed(request):
    """A skin of which the camera sees less than the projector lights."""
    near = replace(RIG, camera=replace(RIG.camera, camera_matrix=_longer(RIG.camera)))
    skin = panel(half=0.6, **({'cylinder_radius': 2.0} if request.param == 'bent' else {}))
    return Scene.of(skin, rig=near)


def _longer(lens):
    return lens.camera_matrix * np.array([[1.6, 1, 1], [1, 1.6, 1], [1, 1, 1]])


def test_the_right_way_round_it_is_measured(unframed):
    measured = Reconstructor(unframed.rig, PATTERN, Settings(stride=2)).measure(unframed.image)
    assert not measured.coverage.confirmed
    assert unframed.errors_mm(measured.cloud).mean() < 0.05


@pytest.mark.parametrize('way', [np.s_[:, ::-1], np.s_[::-1, ::-1]], ids=['mirrored', 'turned'])
def test_mirrored_or_turned_it_is_refused(unframed, way):
    image = np.ascontiguousarray(unframed.image[way])
    with pytest.raises(OtherPatternError, match='do not mirror or turn the photograph'):
        Reconstructor(unframed.rig, PATTERN, Settings(stride=2)).measure(image)
