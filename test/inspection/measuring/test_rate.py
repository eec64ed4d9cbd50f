"""What noise alone lists, and what the stride of a cloud changes."""

import math

import cv2
import numpy as np
import pytest

from ftp_dent_ros import inspect
from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.inspection.measuring.lattice import Lattice
from ftp_dent_ros.inspection.measuring.noise import Noise, measured_noise
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.simulation import Dent, Panel, Photometry, Renderer, Surface

CELL, CELLS, MARGIN = 5e-4, 1000, 100


@pytest.mark.parametrize('reach', [1.5e-3, 4e-3])
def test_noise_passes_the_threshold_as_often_as_is_stated(reach):
    scale, rate = 2e-3, 40.0
    flat = np.zeros((1, 1), np.float32)
    one, none = np.ones(2), np.zeros(2)
    level = Noise(np.array([0, scale]), one, none, flat, reach, 1, one).significant(rate)
    wide = math.hypot(scale, reach) / CELL
    rng, passed, side = np.random.default_rng(5), 0, CELLS + 2 * MARGIN
    for _ in range(6):
        white = rng.standard_normal((side, side)).astype(np.float32)
        field = 2 * math.sqrt(math.pi) * wide * cv2.GaussianBlur(white, (0, 0), wide)
        field = field[MARGIN:-MARGIN, MARGIN:-MARGIN]
        for sign in (1, -1):
            beyond = sign * field > level
            passed += cv2.connectedComponents(beyond.view(np.uint8))[0] - 1
    expected = rate * 6 * (CELL * CELLS) ** 2
    assert abs(passed - expected) < 3 * math.sqrt(expected)


def wider_for(field):
    """How much wider noise is tested than it is, after it was measured in a field."""
    known, points = np.ones(field.shape, bool), np.zeros((*field.shape, 3), np.float32)
    stated, spacing = np.ones_like(field), (CELL, CELL)
    lattice = Lattice(points, known, stated, None, 1, spacing, np.zeros(3), points, known)
    noise = measured_noise(field, [field], known, lattice, (CELL,))
    return float(np.median(noise.tested(CELL) / noise.after(CELL)))


def test_noise_whose_strength_scatters_is_tested_as_rare_as_normal_noise_is():
    rng = np.random.default_rng(5)
    normal = rng.standard_normal((CELLS, CELLS), np.float32)
    strength = cv2.resize(
        rng.chisquare(12, (50, 50)), normal.shape, interpolation=cv2.INTER_NEAREST
    )
    scattered = (normal / np.sqrt(strength / 12)).astype(np.float32)
    dented = np.where(rng.random(normal.shape) < 0.02, 6, normal).astype(np.float32)
    # Student's t of 12 degrees passes 10.4 standard deviations as rarely as a normal one 5.4.
    assert 0.85 < wider_for(scattered) / (10.4 / 5.4) < 1.3
    assert wider_for(normal) < 1.1
    assert wider_for(dented) < 1.1


def test_every_stride_has_the_same_list():
    rig, pattern = make_rig(0.8, 0.24, (640, 360, 1700.0), 1890.0), Pattern(1280, 720, 10.0, 640.0)
    dents = Dent(-0.05, 0.01, 0.04, 0.03, 4e-4, 0.4), Dent(0.05, -0.01, 0.025, 0.025, 2e-4)
    surface = Surface((Panel(Pose.from_rpy((0, 0, 0), (0, 0, 0.8)), (-2, 2, -2, 2), dents=dents),))
    light = Photometry(exposure=1.0, ambient=0.03, reference_distance=0.8)
    photograph = Renderer(rig, pattern.draw(), light).render(surface, np.random.default_rng(5))
    first, *others = (
        inspect(Reconstructor(rig, pattern, Settings(stride=stride)).measure(photograph).cloud)
        for stride in (1, 2, 4)
    )
    assert [dent.kind for dent in (*first.dents, *first.others)] == ['dent', 'dent']
    for found in others:
        assert not found.others
        for one, other in zip(first.dents, found.dents, strict=True):
            for name in ('depth', 'length', 'width'):
                a, b = getattr(one, name), getattr(other, name)
                assert abs(a.value - b.value) < 2 * math.hypot(a.uncertainty, b.uncertainty)
