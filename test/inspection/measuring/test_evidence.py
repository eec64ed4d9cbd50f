import cv2
import numpy as np
import pytest
from small_clouds import cloud_of, panel

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Settings
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.measuring.outlines.outline import find_outline
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.places.evidence import (
    SIGNIFICANT,
    SUSPECT,
    by_chance,
    chance,
    fitted_depth,
    threshold,
)
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import Noise

STEP = 1e-3
X, Y = np.meshgrid(STEP * np.arange(-60, 61), STEP * np.arange(-60, 61))


def patch_of(depth):
    every = np.ones(depth.shape, bool)
    return Patch((X[0, 0], Y[0, 0]), STEP, depth, every, STEP, np.zeros(depth.shape))


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


def spotted(seed):
    """Flat skin with forty spots whose errors are told by their order of magnitude only."""
    rng = np.random.default_rng(seed)
    cloud = cloud_of(panel(), noise=1e-6, seed=seed)
    size = cloud.intensity.shape
    white = cv2.GaussianBlur(rng.normal(size=size), (0, 0), 1.5)
    told, real = np.full(size, 1e-6, np.float32), np.zeros(size)
    for row, column in rng.integers(10, (size[0] - 20, size[1] - 20), (40, 2)):
        spot = slice(row, row + 9), slice(column, column + 9)
        told[spot], real[spot] = 3e-5, 3e-5 * np.sqrt(rng.exponential())
    longer = 1 + real * white / white.std() / cloud.points[..., 2]
    points = cloud.points * longer[..., None].astype(np.float32)
    return Cloud(points, cloud.intensity, told, np.full(size, 5e-3, np.float32))


def test_what_chance_makes_of_many_doubtful_places_is_not_listed():
    # At three standard deviations there were seven.
    listed = [inspect(spotted(seed)) for seed in range(6)]
    assert not any(found.dents for found in listed)
    assert sum(len(found.others) for found in listed) <= 2


def test_more_doubtful_places_ask_for_more_evidence():
    lattice = Lattice.of(cloud_of(panel()), Settings())
    skin = lattice.valid
    asked = []
    for part in (0.001, 0.01, 0.03, 1.0):
        extra = np.where(np.arange(skin.size).reshape(skin.shape) < part * skin.size, 5e-5, 1e-7)
        noise = Noise(np.full(3, 1e-6), np.array([0, 2e-3, 1e-2]), extra.astype('f4'), 1.5e-3)
        asked.append(threshold(by_chance(noise, skin, lattice)))
    assert SUSPECT < asked[0] < asked[1] < asked[2] <= asked[3] == SIGNIFICANT


@pytest.mark.parametrize('places', [1, 2, 3, 5, 8])
def test_means_over_several_places_ask_for_what_sums_of_laplace_variates_do(places):
    rng = np.random.default_rng(places)
    sums = rng.gamma(places, size=400_000) - rng.gamma(places, size=400_000)
    sums = np.abs(sums) / np.sqrt(2 * places)
    for share in (2e-3, 5e-4):
        beyond = np.mean(sums > threshold(share, places))
        assert share / 3 < beyond < 1.2 * share
