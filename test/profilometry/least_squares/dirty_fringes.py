"""Fringes on a plane under dirt, about whose true phase a fit's step is all the dirt's."""

import numpy as np

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import Equations, MaskedFit
from ftp_dent_ros.simulation import Dirt

PERIOD = 10.4
GRID = Grid.for_fringes(640, 360, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)


def dirty_fringes() -> tuple[np.ndarray, Equations]:
    """Levels of the bins, and the equations of their fringes about the true phase."""
    v, u = np.mgrid[:360, :640].astype(np.float32)
    scale = np.float32(4e-4)  # metres a pixel
    light = Dirt(0.25, seed=3).factor(u * scale, v * scale)
    light *= 1 + np.float32(0.7) * np.cos(np.float32(2 * np.pi / PERIOD) * u)
    bins = GRID.binned(np.round(100 * light).astype(np.uint8))
    columns, _ = GRID.bin_positions()
    phase = np.broadcast_to(2 * np.pi / PERIOD * columns, bins.shape).astype(np.float32)
    return bins, MaskedFit(GRID, WINDOWS).equations(phase, np.ones(bins.shape, bool), None)
