"""Valleys that the cloud doubts at every single place are seen by all of their length."""

from __future__ import annotations

import numpy as np
import pytest
from small_clouds import cloud_of, panel

from ftp_dent_ros.dents.dent import Settings
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.lines import valleys
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import Noise, smoothed

LATTICE = Lattice.of(cloud_of(panel()), Settings())
WIDTH, DEEP, DOUBT = 0.01, 4.5e-4, 1.2e-4


def along_and_across(angle):
    rows, columns = LATTICE.valid.shape
    x = LATTICE.spacing[0] * (np.arange(columns) - columns / 2)
    y = LATTICE.spacing[1] * (np.arange(rows) - rows / 2)[:, None]
    return x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)


def found(depth, angle, uneven=1e-3):
    """What is found of `depth`, over a stretch of 60 by 10 mm that the cloud is in doubt of."""
    along, across = along_and_across(angle)
    doubtful = (np.abs(along) < 0.03) & (np.abs(across) < 0.005)
    extra = np.where(doubtful, DOUBT, 1e-6).astype(np.float32)
    noise = Noise(np.full(4, 1e-6), np.array([0, 2e-3, 5e-3, 1e-2]), extra, 2e-3)
    values = np.where(doubtful, depth, 0).astype(np.float32)
    maps = [smoothed(values, LATTICE.valid, LATTICE.cells(scale)) for scale in noise.scales[1:]]
    # No single place reaches what is listed by itself.
    assert np.nanmax((maps[0] / noise.after(2e-3))[doubtful]) < 6
    skin = BareSkin(None, None, None, noise, maps, 6.0, uneven, 0.1)
    seeds = LATTICE.valid & (maps[0] > 1e-4)
    return valleys(skin, LATTICE.valid, seeds, LATTICE, WIDTH, 2.5e-5)


def valley(angle):
    _, across = along_and_across(angle)
    return DEEP * np.exp(-((across / 2.5e-3) ** 2))


@pytest.mark.parametrize('angle', [0.0, 0.4, 1.1, np.pi / 2, 2.4])
def test_a_valley_in_doubt_is_seen_by_all_of_its_length(angle):
    along, across = along_and_across(angle)
    middle = (np.abs(along) < 0.02) & (np.abs(across) < 1e-3)
    cells = found(valley(angle), angle)
    assert cells[middle].mean() > 0.9
    assert not cells[np.abs(across) > 6e-3].any()


def test_where_more_is_in_doubt_by_chance_more_is_asked_for():
    assert not found(0.6 * valley(0.4), 0.4, uneven=1e-6).any()


def test_what_goes_to_and_fro_as_the_fringes_do_is_no_valley():
    along, _ = along_and_across(0.4)
    assert not found(valley(0.4) * np.cos(2 * np.pi * along / 7e-3), 0.4).any()
