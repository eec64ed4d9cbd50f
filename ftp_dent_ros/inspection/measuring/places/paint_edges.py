"""Whether something long lies along an edge of paint, whose light feigns depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice

# Cells beside a mark that tell its two sides, from where on and how far.
_FROM, _TO = 2.0, 6.0
# The darker side has at most this part of the other's light. The slopes of a crease shade it by
# 5 %, fringes of a few cells and gloss the sides by less than that; the simulated patches and
# letters have 0.3 to 0.7.
_DARKER = 0.8
_FEWEST = 8


def along_paint(rows: NDArray[np.intp], columns: NDArray[np.intp], lattice: Lattice) -> bool:
    """Whether the light differs between the two sides of some cells, across their short axis."""
    cells = np.stack([rows, columns], axis=1).astype(float)
    middle = cells.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov((cells - middle).T))
    place = (cells - middle) @ axes
    half, width = np.abs(place[:, 1]).max(), np.abs(place[:, 0]).max()
    reach = int(np.ceil(half + width + _TO)) + 1
    top, left = (max(round(each) - reach, 0) for each in middle)
    every = slice(None, None, lattice.block)
    light = lattice.light[every, every][top : top + 2 * reach + 1, left : left + 2 * reach + 1]
    near = np.moveaxis(np.indices(light.shape), 0, -1)
    off = (near + np.array([top, left]) - middle) @ axes
    beside = (np.abs(off[..., 1]) < half) & (light > 0)
    beside &= (np.abs(off[..., 0]) > width + _FROM) & (np.abs(off[..., 0]) < width + _TO)
    sides = [light[beside & (sign * off[..., 0] > 0)] for sign in (1, -1)]
    if min(map(len, sides)) < _FEWEST:
        return False
    darker, lighter = sorted(float(np.median(side)) for side in sides)
    return darker < _DARKER * lighter
