"""How much a dent has grown, by the skins about it in two surveys that lie otherwise."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from dent_samples import make_dent
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.growth import depth_growth
from ftp_dent_ros.survey.result import DentRelief, SurveyedDent

SIZES, DEPTH, NOISE = (0.03, 0.02), 5e-4, 4e-6


def skin(x, y, depth):
    """A cylinder with a dent, its length along x."""
    form = np.exp(-((x / SIZES[0]) ** 2 + (y / SIZES[1]) ** 2) * 4 * np.log(10))
    return -(y**2) / 4 - depth * form


def surveyed(rng, depth, frame):
    """The dent as a survey has it in its frame: a little off its place, and turned on the skin."""
    turn, place = rng.normal(0, 0.1), rng.normal(0, 3e-4, 2)
    axis = np.array([np.cos(turn), np.sin(turn), 0])
    spacing = 1e-3
    a, b = DentRelief(spacing, np.zeros((45, 61), np.float32)).places()
    x = place[0] + a * axis[0] - b * axis[1]
    y = place[1] + a * axis[1] + b * axis[0]
    noise = cv2.GaussianBlur(rng.normal(size=a.shape), (0, 0), 2.5)
    heights = skin(x, y, depth) + NOISE * noise / noise.std()
    dent = make_dent(
        frame.apply(np.array([*place, 0.0])),
        depth,
        *SIZES,
        normal=frame.rotation.apply([0, 0, 1.0]),
        axis=frame.rotation.apply(axis),
    )
    relief = DentRelief(spacing, heights.astype(np.float32))
    return SurveyedDent(1, dent, np.eye(3) * 1e-6, 5, relief)


def compared(seed, growth):
    rng = np.random.default_rng(seed)
    frames = [Pose(Rotation.random(random_state=seed + k), rng.normal(0, 9, 3)) for k in (0, 1)]
    earlier, later = (
        surveyed(rng, depth, frame)
        for depth, frame in zip((DEPTH, DEPTH + growth), frames, strict=True)
    )
    return earlier, later, frames[1] @ frames[0].inverse()


@pytest.mark.parametrize('growth', [0.0, 5e-5, -1e-4])
def test_growth_is_as_sure_as_it_says_wherever_the_surveys_lie(growth):
    found = [depth_growth(*compared(seed, growth)).estimate for seed in range(40)]
    off = np.array([(each.value - growth) / each.uncertainty for each in found])
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
    assert max(each.uncertainty for each in found) < 2 * NOISE


def test_what_is_not_measured_is_not_compared():
    earlier, later, pose = compared(1, 0.0)
    heights = later.relief.heights.copy()
    heights[:, :30] = np.nan
    assert depth_growth(earlier, replace(later, relief=DentRelief(1e-3, heights)), pose) is None
    assert depth_growth(replace(earlier, relief=None), later, pose) is None
