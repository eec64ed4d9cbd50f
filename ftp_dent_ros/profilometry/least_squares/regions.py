"""Which nodes belong to which surface, and which surfaces are tied to one another."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.continuation import continued_by_slope
from ftp_dent_ros.profilometry.least_squares.first_fit import Fringes
from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.windows import Windows
from ftp_dent_ros.profilometry.unwrapping import wrap

# Grey levels: an amplitude that gives a phase worth having.
_LEAST_MODULATION = 2.5
# Of the shoulder beside it: a window half beside the surface, and one that sees two surfaces.
_RIM = 0.5
_VALLEY = 0.6
# Misfit, in fringe amplitudes and in those of all, that tells of an edge; gaps in it that are
# closed, fringes; phase across it that is still the same surface, radians.
_ROUGH, _ROUGH_NOISE = 0.04, 4.0
_GAP = 12.0
_TIED = 0.25
_SMALLEST = 30  # nodes of a surface


def fringe_region(
    fringes: Fringes, windows: Windows, grid: Grid, period: float
) -> NDArray[np.bool_]:
    """Nodes that see fringes of one surface."""
    nu, nv = (math.ceil(period / pitch) for pitch in grid.pitch)
    reach = [2 * math.ceil(2 * s) + 2 * n + 1 for s, n in ((windows.sigma_v, nv), (windows.sigma_u, nu))]
    lit = fringes.modulation > _LEAST_MODULATION
    beside_dark = cv2.dilate((~lit).view(np.uint8), np.ones(reach, np.uint8), borderValue=0) > 0
    shoulder = cv2.dilate(fringes.modulation, np.ones((2 * nv + 1, 2 * nu + 1), np.uint8))
    between = cv2.morphologyEx(
        fringes.modulation, cv2.MORPH_CLOSE, np.ones((2 * nv + 1, 4 * nu + 1), np.uint8)
    )
    return (
        lit
        & (~beside_dark | (fringes.modulation > _RIM * shoulder))
        & (fringes.modulation > _VALLEY * between)
    )


def apart(
    region: NDArray[np.bool_], others: NDArray[np.bool_], grid: Grid, period: float
) -> NDArray[np.bool_]:
    """The nodes of `region` that are not beside nodes of other surfaces."""
    size = [2 * math.ceil(0.7 * period / pitch) + 1 for pitch in grid.pitch[::-1]]
    return region & ~(cv2.dilate(others.view(np.uint8), np.ones(size, np.uint8)) > 0)


def tied_region(
    region: NDArray[np.bool_],
    misfit: NDArray[np.float32],
    shift: NDArray[np.float32],
    home: NDArray[np.bool_],
    windows: Windows,
    grid: Grid,
    period: float,
) -> NDArray[np.bool_]:
    """The part of a region whose phase goes on, across all edges, from where the stripe is.

    Where no smooth phase explains the photograph there is an edge, of paint or of the surface.
    What lies beyond an edge is the same surface if its phase is where this side's slope leads.

    Parameters
    ----------
    region : ndarray, shape (rows, columns), bool
        Nodes.
    misfit : ndarray, shape (rows, bins), float32
        Of the bins, in fringe amplitudes.
    shift : ndarray, shape (rows, columns), float32
        Phase shift at the nodes, radians.
    home : ndarray, shape (rows, columns), bool
        Nodes on the stripe.
    """
    rough = np.sqrt(windows.gaussian(grid.at_nodes(np.square(np.clip(misfit, -1, 1)))))
    inner = cv2.erode(region.view(np.uint8), np.ones((7, 7), np.uint8), borderValue=0) > 0
    if not inner.any():
        return region
    edge = inner & (rough > max(_ROUGH, _ROUGH_NOISE * float(np.median(rough[inner]))))
    if not edge.any():
        return region
    lines = edge.view(np.uint8)
    for shape in ((1, int(_GAP * period / grid.pitch[0])), (int(_GAP * period / grid.pitch[1]), 1)):
        lines = lines | cv2.morphologyEx(edge.view(np.uint8), cv2.MORPH_CLOSE, np.ones(shape))
    lines = cv2.dilate(lines, np.ones((3, 3), np.uint8)) > 0
    count, labels = cv2.connectedComponents((region & ~lines).view(np.uint8), connectivity=4)
    sizes = np.bincount(labels.ravel(), minlength=count)
    at_home = np.bincount(labels[home & region & ~lines], minlength=count)
    at_home[0] = 0
    if count <= 2 or not at_home.any():
        return region
    tied = labels == int(at_home.argmax())
    near = [2 * math.ceil(2 * period / pitch) + 1 for pitch in grid.pitch[::-1]]
    waiting = [label for label in range(1, count) if sizes[label] >= _SMALLEST and label != int(at_home.argmax())]
    while waiting:
        ahead = continued_by_slope(shift, tied, windows)
        beside = cv2.dilate(tied.view(np.uint8), np.ones(near, np.uint8)) > 0
        joined = []
        for label in waiting:
            seam = beside & (labels == label)
            print(label,sizes[label],seam.sum(),np.percentile(np.abs(wrap(shift-ahead)[seam]),[10,25,50,75,90]).round(3)) if seam.any() else None
            if seam.any() and np.median(np.abs(wrap(shift - ahead)[seam])) < _TIED:
                joined.append(label)
        if not joined:
            break
        tied |= np.isin(labels, joined)
        waiting = [label for label in waiting if label not in joined]
    if not waiting:
        return region
    return apart(region, np.isin(labels, waiting), grid, 3 * period)
