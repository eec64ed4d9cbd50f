"""Sizes of dents where the cloud is in doubt of some of their points: so are the sizes."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from small_clouds import COLUMNS, ROWS, cloud_of, panel

from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.simulation import Dent

NOISE = 4e-6
DENT = Dent(0.0, 0.0, 0.05, 0.05, 0.001)
SEEDS = range(8)


def told(errors, sigma):
    """The dent's cloud with errors, which it tells of; both in metres."""
    cloud = cloud_of(panel(DENT), noise=NOISE)
    rays = cloud.points / cloud.points[..., 2:]
    points = (cloud.points + errors[..., None] * rays).astype(np.float32)
    resolution = np.full((ROWS, COLUMNS), 6e-3, np.float32)
    return replace(cloud, points=points, sigma=sigma.astype(np.float32), resolution=resolution)


def off_middle():
    """From the dent's middle to each point on the skin, metres across columns and rows."""
    cloud = cloud_of(panel(DENT), noise=0.0)
    deepest = panel(DENT).pose.translation
    return cloud.points[..., 0] - deepest[0], cloud.points[..., 1] - deepest[1]


def correlated(seed):
    """Noise of variance 1 that is alike over a few points."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(ROWS, COLUMNS)), (0, 0), 1.6)
    return noise / noise.std()


def measured(cloud):
    """What lies at the dent's place."""
    found = inspect(cloud)
    near = [
        each
        for each in (*found.dents, *found.others)
        if np.linalg.norm(each.position - panel(DENT).pose.translation) < 0.02
    ]
    return max(near, key=lambda each: each.depth.value)


def test_a_depth_in_a_strip_that_the_cloud_doubts_is_as_uncertain():
    across, _ = off_middle()
    sigma = np.hypot(NOISE, 1.5e-4 * np.exp(-np.square(across / 0.006)))
    ratios = []
    for seed in SEEDS:
        dent = measured(told(sigma * correlated(seed), sigma))
        ratios.append((dent.depth.value - DENT.depth) / dent.depth.uncertainty)
        assert dent.depth.uncertainty > 7e-5
    assert np.sqrt(np.mean(np.square(ratios))) < 1.8


def test_doubt_beside_a_dent_is_none_of_its_depth():
    across, _ = off_middle()
    sigma = np.hypot(NOISE, 1.5e-4 * np.exp(-np.square((across - 0.05) / 0.006)))
    dent = measured(told(sigma * correlated(1), sigma))
    assert dent.depth.uncertainty < 2e-5
    assert abs(dent.depth.value - DENT.depth) < 2.5 * dent.depth.uncertainty


def test_lengths_are_as_uncertain_as_the_rim_that_they_end_at():
    across, down = off_middle()
    length, width = DENT.size()
    at_rim = np.exp(-np.square((np.hypot(across, down) - length / 2) / 0.004))
    # Deeper at two ends, as light on slopes feigns.
    sigma = np.hypot(NOISE, 3e-5 * at_rim)
    errors = 3e-5 * at_rim * np.square(across) / (np.square(across) + np.square(down) + 1e-9)
    dent = measured(told(errors, sigma))
    plain = measured(told(0 * errors, 0 * sigma + NOISE))
    assert plain.length.uncertainty < 4e-4
    assert dent.length.value > length + 5e-4
    assert dent.length.value < length + 2 * dent.length.uncertainty
    assert abs(dent.width.value - width) < 2 * dent.width.uncertainty
    assert abs(dent.depth.value - DENT.depth) < 2 * dent.depth.uncertainty


@pytest.mark.xfail(strict=True, reason='it is listed as a dent that is cut')
def test_what_is_doubted_and_cut_by_what_was_not_measured_is_listed_in_doubt():
    across, down = off_middle()
    sigma = np.hypot(NOISE, 3e-4 * np.exp(-np.square(across / 0.012)))
    cloud = told(sigma * correlated(2), sigma)
    points = cloud.points.copy()
    points[np.abs(across - 0.004) < 0.003] = np.nan
    points[down > 0.012] = np.nan
    dent = measured(replace(cloud, points=points))
    assert dent.kind == 'other'
    assert dent.is_cut
    assert 'not sure' in dent.reason or 'not measured' in dent.reason
    assert abs(dent.depth.value - DENT.depth) < 2.5 * dent.depth.uncertainty


@pytest.mark.xfail(strict=True, reason='two dents are listed')
def test_beside_a_mark_in_a_dent_its_depth_is_told_by_what_is_known_well():
    x, y = off_middle()
    strip = np.exp(-np.square(x / 5e-3) / 2)
    cloud = told(0.4e-3 * strip * np.cos(y / 3e-3), 5e-6 + 0.15e-3 * strip)
    mark = np.where(abs(x) < 1.5e-3, 90, 150).astype(np.uint8)
    plain = inspect(cloud).dents[0]
    (dent,) = inspect(replace(cloud, skin=mark)).dents
    error = dent.depth.value - DENT.depth
    assert abs(error) < 2 * dent.depth.uncertainty
    assert abs(error) < (plain.depth.value - DENT.depth) / 2
