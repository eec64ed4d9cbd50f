import cv2
import numpy as np
import pytest

from ftp_dent_ros.inspection.measuring.evidence import chance, fitted_depth
from ftp_dent_ros.inspection.measuring.noise import Noise
from ftp_dent_ros.inspection.measuring.outline import find_outline
from ftp_dent_ros.inspection.measuring.patch import Patch

STEP = 1e-3
X, Y = np.meshgrid(STEP * np.arange(-60, 61), STEP * np.arange(-60, 61))


def patch_of(depth):
    return Patch((X[0, 0], Y[0, 0]), STEP, depth, np.ones(depth.shape, bool), STEP)


def gaussian(length, width, angle, depth):
    c, s = np.cos(angle), np.sin(angle)
    u, v = (c * X + s * Y) / length, (c * Y - s * X) / width
    return depth * 10 ** (-4 * (u * u + v * v))


def test_the_depth_of_a_gaussian_is_fitted():
    patch = patch_of(gaussian(0.05, 0.03, 0.4, 3e-4))
    outline = find_outline(patch, (60, 60), 3e-5)
    length, angle, _ = outline.length()
    width, _ = outline.width(angle)
    assert fitted_depth(patch, outline, length, width, angle) == pytest.approx(3e-4, rel=0.02)


def test_noise_fitted_by_a_gaussian_strays_as_much_as_is_told():
    rng = np.random.default_rng(1)
    reach, sigma, width = 1.5e-3, 1e-4, 0.03
    noise = Noise(np.full(2, 1e-9), np.array([0.0, 0.01]), np.zeros((1, 1), np.float32), reach)
    # A Gaussian mean of white noise is correlated over so many of its standard deviations.
    outline = find_outline(patch_of(gaussian(width, width, 0, 1.0)), (60, 60), 0.1)
    depths = []
    for _ in range(60):
        white = cv2.GaussianBlur(rng.normal(size=X.shape), (0, 0), reach / STEP)
        patch = patch_of(sigma * white / white.std())
        depths.append(fitted_depth(patch, outline, width, width, 0.0))
        assert np.abs(patch.depth).max() > 6 * chance(noise, width, sigma)
    assert np.std(depths) == pytest.approx(chance(noise, width, sigma), rel=0.25)
