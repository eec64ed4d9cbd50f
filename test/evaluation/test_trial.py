from dataclasses import replace

import numpy as np
import pytest

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.evaluation.scenes import simulated_dent
from ftp_dent_ros.evaluation.study import ITOH, Figures, engine, mean, trial

SCENE = simulated_dent()
BLACK = np.zeros((720, 1280, 3), np.uint8)


@pytest.fixture(scope='module')
def lit():
    return SCENE.lit()


class Perfect:
    """A reconstruction that gives the true surface, moved along the view by so much."""

    def __init__(self, offset=0.0, deeper=0.0):
        rays = SCENE.rig.camera.rays(SCENE.rig.camera.pixel_grid())
        depth = np.full(rays.shape[:2], 1.0)
        x, y = SCENE.on_panel(rays)
        depth += SCENE.dent.height(x, y)[0] * (1 + deeper / SCENE.dent.depth) + offset
        self.cloud = Cloud((rays * depth[..., None]).astype(np.float32), depth)

    def measure(self, image):
        return self


def test_an_offset_is_an_error_but_no_bias_of_the_depth(lit):
    figures, _ = trial(Perfect(offset=1e-4), SCENE, lit, BLACK)
    assert figures.mae == pytest.approx(0.1, rel=0.01)
    assert figures.deviation < 0.01 and figures.coverage == 1.0
    assert figures.depth_bias == pytest.approx(0, abs=0.02)


def test_a_dent_that_comes_out_too_deep_has_a_positive_bias(lit):
    figures, _ = trial(Perfect(deeper=2e-4), SCENE, lit, BLACK)
    assert figures.depth_bias == pytest.approx(0.2, abs=0.03)
    assert figures.dent_mae > 5 * figures.mae


def test_noise_is_on_the_phase_of_one_photograph_alone_and_what_is_refused_has_no_figures(lit):
    direct, image = engine(next(iter(ITOH.values())), SCENE.rig), SCENE.photograph()
    clean, _ = trial(direct, SCENE, lit, image)
    noise = np.random.default_rng(0).normal(0, 0.6, lit.shape).astype(np.float32)
    noisy, error = trial(direct, SCENE, lit, image, noise)
    assert np.isnan(noisy.mae) and noisy.coverage == 0 and error is None
    again, _ = trial(direct, SCENE, lit, image)
    assert again.mae == clean.mae < 0.05


def test_the_mean_is_of_what_was_not_refused():
    good = Figures(1.0, 2.0, 3.0, 4.0, 1.0, 0.5)
    refused = replace(good, mae=np.nan, deviation=np.nan, coverage=0.0)
    both = mean([good, refused])
    assert (both.mae, both.coverage) == (1.0, 0.5)
    assert np.isnan(mean([refused]).mae)
