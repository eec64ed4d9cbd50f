"""Grooves under light marks are gouges; marks, creases that gleam and grooves alone are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dent_samples import gouged_cloud

from ftp_dent_ros.inspection.measuring.inspection import inspect


def kinds(cloud):
    found = inspect(cloud)
    return [dent.kind for dent in (*found.dents, *found.others)]


@pytest.mark.parametrize('angle', [0.0, 0.5, 1.1, -0.8])
@pytest.mark.parametrize('depth', [0.2e-3, 0.6e-3])
def test_a_groove_under_a_light_mark_is_a_gouge(angle, depth):
    found = inspect(gouged_cloud(depth, angle=angle))
    (dent,), (gouge,) = found.dents, found.others
    assert gouge.kind == 'gouge' and gouge.significance > 4
    np.testing.assert_allclose(gouge.position[:2], 0, atol=1e-3)
    assert abs(gouge.axis @ [np.cos(angle), np.sin(angle), 0]) > 0.999
    truth = {'depth': depth, 'length': 30e-3, 'width': 4e-3}
    for name, true in truth.items():
        told = getattr(gouge, name)
        assert abs(told.value - true) < 2 * told.uncertainty < true
    assert 'resolves 6.0 mm' in gouge.reason
    np.testing.assert_allclose(dent.depth.value, 0.5e-3, rtol=0.05)


@pytest.mark.parametrize(
    'cloud',
    [
        # Paint alone; a groove that is shallower than paint may feign; a mark along the fringes.
        gouged_cloud(0.0),
        gouged_cloud(0.05e-3),
        gouged_cloud(0.4e-3, angle=np.pi / 2),
        # A gleam on one flank; a mark that is darker, or hardly lighter.
        gouged_cloud(0.4e-3, offset=3e-3),
        gouged_cloud(0.4e-3, mark=-0.2),
        gouged_cloud(0.4e-3, mark=0.02),
        # Nothing known of the skin's light, or of what the cloud resolves.
        replace(gouged_cloud(0.4e-3), skin=np.zeros((200, 300), np.uint8)),
        replace(gouged_cloud(0.4e-3), resolution=np.full((200, 300), np.nan, np.float32)),
    ],
)
def test_nothing_else_is_a_gouge(cloud):
    assert 'gouge' not in kinds(cloud)


def test_what_a_mark_along_the_fringes_may_feign_is_in_doubt():
    cloud = gouged_cloud(0.6e-3, angle=np.pi / 2)
    (found,) = inspect(cloud).others
    assert (found.kind, found.reason.partition(',')[0]) == (
        'other',
        'on a light mark along the fringes',
    )
    (plain,) = inspect(replace(cloud, skin=np.zeros_like(cloud.skin))).others
    assert plain.kind == 'crease'


def test_marks_that_are_no_bars_are_no_marks_of_gouges():
    cloud = gouged_cloud(0.4e-3)
    x, y = cloud.points[..., 0], cloud.points[..., 1]
    for shape in (np.abs(np.hypot(x, y) - 0.01) < 1e-3, np.hypot(x, y) < 0.01):
        assert 'gouge' not in kinds(
            replace(cloud, skin=np.where(shape, 180, 150).astype(np.uint8))
        )


def test_a_gouge_at_the_rim_of_the_cloud_ends_nothing():
    cloud = gouged_cloud(0.4e-3)
    for cut in (np.s_[90:], np.s_[:110], np.s_[:, 95:], np.s_[:, :120]):
        part = {
            name: np.ascontiguousarray(getattr(cloud, name)[cut])
            for name in ('points', 'intensity', 'sigma', 'resolution', 'skin')
        }
        inspect(replace(cloud, **part))


def test_a_groove_that_the_mark_may_feign_is_in_doubt():
    cloud = gouged_cloud(0.2e-3)
    # So doubtful beside the mark that the groove is no longer beyond what paint may feign.
    doubted = replace(cloud, sigma=np.where(cloud.sigma > 5e-5, np.float32(2.4e-4), cloud.sigma))
    (found,) = inspect(doubted).others
    assert (found.kind, found.reason) == (
        'other',
        'a narrow light mark, under which there may be a groove',
    )
    np.testing.assert_allclose(found.depth.value, 0.2e-3, rtol=0.2)
    assert abs(found.depth.value - 0.2e-3) < 2 * found.depth.uncertainty


def test_a_mark_along_the_fringes_is_in_doubt_and_a_light_line_of_one_point_is_none():
    cloud = gouged_cloud(0.3e-3, angle=np.pi / 2)
    wide = replace(cloud, sigma=np.where(cloud.sigma > 5e-5, np.float32(1.6e-4), cloud.sigma))
    assert kinds(wide).count('other') == 1
    x, y = cloud.points[..., 0], cloud.points[..., 1]
    line = (np.abs(x) < 0.3e-3) & (np.abs(y) < 0.015)
    assert not inspect(replace(wide, skin=np.where(line, 180, 150).astype(np.uint8))).others
