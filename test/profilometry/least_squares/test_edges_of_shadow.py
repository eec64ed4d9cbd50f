"""Where an edge of shadow is, and how soft, by the light of its bins."""

import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.fit.edges_of_shadow import (
    edges_of_shadow,
    half_shadow,
)

PERIOD, BLUR = 4.5, 0.6
ROWS = np.arange(30)


def crossed(rows=ROWS):
    mask = np.zeros((40, 120), bool)
    mask[rows, np.rint(50 + 0.3 * rows).astype(int)] = True
    return mask


@pytest.mark.parametrize('deviation', [0.6, 1.5, 4.0])
def test_light_grows_from_none_to_all_with_the_deviation_that_is_asked_for(deviation):
    away = np.linspace(-20, 20, 2001)
    share = half_shadow(away, np.array(deviation), BLUR)
    assert share[[0, 1000, -1]] == pytest.approx([0, 0.5, 1], abs=1e-6)
    slope = np.diff(share)
    assert (slope > -1e-12).all()
    middle = (away[1:] + away[:-1]) / 2
    assert np.sqrt((slope * middle**2).sum()) == pytest.approx(deviation, rel=0.01)


@pytest.mark.parametrize('deviation', [0.7, 1.5, 3.0])
def test_an_edge_is_found_where_it_is_and_as_soft_as_it_is(deviation):
    (edge,) = edges_of_shadow(crossed(), PERIOD, BLUR)
    true = 50.3 + 0.3 * ROWS
    noise = np.random.default_rng(3).normal(0, 1, edge.away.shape)
    leap, seen = np.full(noise.shape, 80.0), np.ones(noise.shape, bool)
    for _ in range(3):
        distance = edge.index[1] - true[:, None]
        rest = 80 * half_shadow(distance, np.array(deviation), BLUR) + noise
        edge = edge.fitted(rest, leap, seen)
    assert edge.place == pytest.approx(true, abs=0.1)
    assert edge.deviation == pytest.approx(np.full(30, deviation), rel=0.1)
    assert edge.soft == (deviation > 1)


def test_what_has_few_rows_or_is_a_patch_is_no_edge():
    assert not edges_of_shadow(crossed(ROWS[:5]), PERIOD, BLUR)
    patch = np.zeros((40, 120), bool)
    patch[5:30, 40:60] = True
    assert not edges_of_shadow(patch, PERIOD, BLUR)
