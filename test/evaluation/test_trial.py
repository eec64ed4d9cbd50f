from dataclasses import replace

import numpy as np
import pytest

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.evaluation.scenes import simulated_dent
from ftp_dent_ros.evaluation.study import (
    Bench,
    Figures,
    mean,
    methods,
)

SCENE = simulated_dent()
VIRTUAL = methods('itoh')[1]


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


def figures_of(reconstruction, lit):
    bench = Bench(VIRTUAL, SCENE.rig)
    bench._method = reconstruction
    return bench.run(SCENE, lit, np.zeros((720, 1280, 3), np.uint8)).figures


def test_an_offset_is_an_error_but_no_bias_of_the_depth(lit):
    figures = figures_of(Perfect(offset=1e-4), lit)
    assert figures.mae == pytest.approx(0.1, rel=0.01)
    assert figures.deviation < 0.01 and figures.coverage == 1.0
    assert figures.depth_bias == pytest.approx(0, abs=0.02)


def test_a_dent_that_comes_out_too_deep_has_a_positive_bias(lit):
    figures = figures_of(Perfect(deeper=2e-4), lit)
    assert figures.depth_bias == pytest.approx(0.2, abs=0.03)
    assert figures.dent_mae > 5 * figures.mae


def test_what_is_refused_has_no_figures(lit):
    black = np.zeros((720, 1280, 3), np.uint8)
    trial = Bench(VIRTUAL, SCENE.rig).run(SCENE, lit, black)
    assert np.isnan(trial.figures.mae) and trial.figures.coverage == 0
    assert trial.error_mm is None


def test_the_mean_is_of_what_was_not_refused():
    good = Figures(1.0, 2.0, 3.0, 4.0, 1.0, 0.5)
    refused = replace(good, mae=np.nan, deviation=np.nan, coverage=0.0)
    both = mean([good, refused])
    assert (both.mae, both.coverage) == (1.0, 0.5)
    assert np.isnan(mean([refused]).mae)
