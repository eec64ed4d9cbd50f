"""The coverage that is drawn while flying: of the newest poses, with its gaps."""

import numpy as np
import pytest
from flown_skin import COLUMNS, ROWS, SPACING, FlownSkin
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.footprint import CELL, Footprint, seen_skin

DOWN = Rotation.from_euler('x', np.pi)
SIZE = np.array([COLUMNS, ROWS]) * SPACING


def passes(gap, turn=0.0):
    """Footprints and poses of two passes along x, so far apart on the skin."""
    skin = FlownSkin(8)
    apart = (SIZE[1] + gap) / 2
    poses = [
        Pose(Rotation.from_euler('z', turn) * DOWN, np.array([x, y, 0.8]))
        for y in (-apart, apart)
        for x in np.arange(4) * 0.12
    ]
    return [Footprint.of(skin.seen(pose, i)[0]) for i, pose in enumerate(poses)], poses


@pytest.mark.parametrize('gap', [0.02, 0.05, -0.05])
def test_a_gap_between_passes_is_seen_and_none_where_there_is_none(gap):
    footprints, poses = passes(gap)
    seen = seen_skin(footprints, poses)
    length = SIZE[0] + 3 * 0.12
    # The skin bends away from the camera, which sees 1 % more of it.
    assert seen.area == pytest.approx(length * (2 * SIZE[1] + min(gap, 0)), rel=0.04)
    if gap < 0:
        assert seen.gaps == []
        return
    (found,) = seen.gaps
    assert found.size[0] == pytest.approx(length, abs=0.03)
    assert found.area / found.size[0] == pytest.approx(gap, abs=0.006)
    strips = seen.strips(seen.gap_mask())
    # The skin's cylinder of 2 m, about its axis.
    radius = np.hypot(strips[..., 1], strips[..., 2] + 2.0)
    assert np.abs(radius - 2.0).max() < 2e-3
    sides = np.linalg.norm(np.diff(strips[:, [0, 1, 2]], axis=1), axis=-1)
    assert (sides[:, 0] * sides[:, 1]).sum() == pytest.approx(found.area, rel=0.01)


def test_it_moves_with_the_poses_and_turned_clouds_have_no_holes():
    footprints, poses = passes(-0.06, turn=0.3)
    assert seen_skin(footprints, poses).gaps == []
    apart = [np.array([0, 0.05 * np.sign(pose.translation[1]), 0]) for pose in poses]
    moved = [Pose(p.rotation, p.translation + off) for p, off in zip(poses, apart, strict=True)]
    (gap, *_) = seen_skin(footprints, moved).gaps
    assert gap.area > 20 * CELL**2
    far = [*poses[:-1], Pose(DOWN, np.array([1e5, 1e5, 0.8]))]
    assert seen_skin(footprints, far) is None


def test_poses_that_contradict_each_other_are_drawn_as_far_as_they_can_be():
    footprints, _ = passes(0.02)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        poses = [
            Pose(Rotation.from_rotvec(rng.normal(0, 1, 3)), rng.normal(0, 1, 3))
            for _ in footprints
        ]
        seen = seen_skin(footprints, poses)
        assert seen is None or seen.area < len(footprints)
