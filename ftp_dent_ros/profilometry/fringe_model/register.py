"""Colours that lie beside each other, and what paint makes of that.

Lenses enlarge colours differently. A rig is calibrated on white, in which the phase of all light
is the colours' mean by their shares of the fringes. Paint has other shares, and so another phase.
How far the colours lie apart is smooth over the picture, and the photograph itself shows it.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid
from ftp_dent_ros.profilometry.fringe_model.local_fit import LocalFit
from ftp_dent_ros.profilometry.fringe_model.quadric import quadric_through
from ftp_dent_ros.profilometry.unwrapping import wrap

# Amplitude of a colour whose phase is seen, levels: rounding leaves a hundredth of a radian.
_SEEN = 4.0
# Nodes that tell how far colours lie apart, at least: six unknowns, and a third of outliers.
_LEAST_NODES = 100
# Every how many nodes show it.
_EVERY = 3
# The most that shares differ from those of even colours in what is white to a camera, and the part
# of the picture that must be so; else even colours are white.
_WHITE, _LEAST_WHITE = 0.1, 0.1


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
    few = slice(None, None, _EVERY), slice(None, None, _EVERY)
    amplitude = [cv2.magnitude(each.amplitude, each.slope) for each in colours]
    light = [np.float32(share) * each for share, each in zip(shares, amplitude, strict=True)]
    total = np.maximum(np.add.reduce(light), np.float32(1e-3))
    paint = [each / total for each in light]
    some = np.stack([each[few] for each in paint])
    seen = inside[few] & (np.minimum.reduce([each[few] for each in amplitude]) > _SEEN)
    if np.count_nonzero(seen) < _LEAST_NODES:
        return np.zeros_like(total)
    even = np.array(shares)
    white = seen & (np.abs(some - even[:, None, None]).max(axis=0) < _WHITE)
    if np.count_nonzero(white) > _LEAST_WHITE * np.count_nonzero(seen):
        even = np.median(some[:, white], axis=1)
    phase = [np.arctan2(each.slope[few], each.amplitude[few]) for each in colours]
    x, y = grid.node_places
    places = x[:, ::_EVERY], y[::_EVERY]
    lead = np.zeros_like(total)
    for colour in (0, 2):
        apart = quadric_through(places, wrap(phase[colour] - phase[1]), seen)
        lead += (paint[colour] - np.float32(even[colour])) * apart.at(x, y)
    return lead
