"""Colours that lie beside each other, and what paint makes of that.

Lenses enlarge colours differently. A rig is calibrated on white, in which the phase of all light
is the colours' mean by their shares of the fringes. Paint has other shares, and so another phase.
How far the colours lie apart is smooth over the picture, and the photograph itself shows it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid
from ftp_dent_ros.profilometry.fringe_model.local_fit import LocalFit
from ftp_dent_ros.profilometry.fringe_model.quadric import quadric_through
from ftp_dent_ros.profilometry.fringe_model.start import FAINTEST, LEAST_NODES
from ftp_dent_ros.profilometry.unwrapping import wrap
from ftp_dent_ros.robust import median

# The most that shares differ from those of even colours in what is white to a camera.
_WHITE = 0.1


def lead_of_paint(
    grid: BinGrid,
    colours: Sequence[LocalFit],
    shares: Sequence[float],
    inside: NDArray[np.bool_],
) -> NDArray[np.float32]:
    """Phase of the grey light less what it would be in white, at the nodes, radians.

    Parameters
    ----------
    grid : BinGrid
    colours : sequence of LocalFit
        Red, green and blue about one phase.
    shares : sequence of float
        Of the colours in grey.
    inside : ndarray of bool, shape (rows, nodes)
        Where all colours have the fringes.
    """
    amplitude = [each.swing for each in colours]
    light = [np.float32(share) * each for share, each in zip(shares, amplitude, strict=True)]
    total = np.maximum(np.add.reduce(light), np.float32(1e-3))
    paint = np.stack([each / total for each in light])
    seen = inside & (np.minimum.reduce(amplitude) > FAINTEST)
    if np.count_nonzero(seen) < LEAST_NODES:
        return np.zeros_like(total)
    even = np.array(shares, np.float32)[:, None, None]
    white = seen & (np.abs(paint - even).max(axis=0) < _WHITE)
    if np.count_nonzero(white) >= LEAST_NODES:
        even = np.array([median(each[white]) for each in paint], np.float32)[:, None, None]
    phase = [each.shift for each in colours]
    lead = np.zeros_like(total)
    for colour in (0, 2):
        apart = quadric_through(grid.node_places, wrap(phase[colour] - phase[1]), seen)
        lead += (paint - even)[colour] * apart.at(*grid.node_places)
    return lead
