"""Which nodes see fringes, and of one surface; the edges between surfaces."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.first_fit import Fringes
from ftp_dent_ros.robust import median

# Grey levels: an amplitude that gives a phase worth having.
_LEAST_MODULATION = 2.5
# Of the shoulder beside it: a window half beside the surface, and one that sees two surfaces.
_RIM = 0.5
_VALLEY = 0.6
# Misfit, in fringe amplitudes and in those of all, that tells of an edge; gaps in it that are
# closed, fringes.
_ROUGH, _ROUGH_NOISE = 0.04, 4.0
_FAINT, _FAINT_GAP = 0.3, 40.0
_GAP = 12.0
_LINE = 10  # nodes
# Fringes that are left out beside another surface.
_MARGIN = 0.7
# Nodes whose windows see the rim.
_RIM_NODES = 3
SMALLEST = 30  # nodes of a surface


def fringe_region(
    fringes: Fringes, windows: Windows, grid: Grid, period: float, faintest: float = 1.0
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Nodes that see fringes of one surface, and those in between that see two.

    Parameters
    ----------
    fringes : Fringes
    windows : Windows
    grid : Grid
    period : float
        Of the fringes, pixels.
    faintest : float
        Contrast of the pattern's faintest fringes over that of its strongest: a fringe that its
        code makes faint is neither unlit nor between two surfaces.
    """
    nu, nv = (math.ceil(period / pitch) for pitch in grid.pitch)
    reaches = (windows.sigma_v, nv), (windows.sigma_u, nu)
    reach = [2 * math.ceil(2 * sigma) + 2 * n + 1 for sigma, n in reaches]
    lit = fringes.modulation > _LEAST_MODULATION * faintest
    beside_dark = cv2.dilate((~lit).view(np.uint8), np.ones(reach, np.uint8), borderValue=0) > 0
    shoulder = cv2.dilate(fringes.modulation, np.ones((2 * nv + 1, 2 * nu + 1), np.uint8))
    between = cv2.morphologyEx(
        fringes.modulation, cv2.MORPH_CLOSE, np.ones((2 * nv + 1, 4 * nu + 1), np.uint8)
    )
    valley = fringes.modulation <= _VALLEY * faintest * between
    rim = beside_dark & (fringes.modulation <= _RIM * shoulder)
    return lit & ~rim & ~valley, lit & valley


def apart(
    region: NDArray[np.bool_],
    others: NDArray[np.bool_],
    seams: NDArray[np.bool_],
    grid: Grid,
    period: float,
) -> NDArray[np.bool_]:
    """The nodes of `region` that are not beside other surfaces, nor beside a seam with them."""
    reach = np.ones((2 * _RIM_NODES + 1, 2 * _RIM_NODES + 1), np.uint8)
    foreign = others | (seams & (cv2.dilate(others.view(np.uint8), reach) > 0))
    size = [2 * math.ceil(_MARGIN * period / pitch) + 1 for pitch in grid.pitch[::-1]]
    return region & ~(cv2.dilate(foreign.view(np.uint8), np.ones(size, np.uint8)) > 0)


def rim_strips(
    region: NDArray[np.bool_], lit: NDArray[np.bool_], seams: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Lit nodes between a region and the dark, so few that no window is theirs alone.

    Where a bright panel ends before the dark, the first fit takes the end for fringes, and cuts
    off the rim. Where there are other surfaces, none: a strip may be of theirs.
    """
    if eroded(lit & ~region).any():
        return np.zeros_like(region)
    reach = np.ones((2 * _RIM_NODES + 1, 4 * _RIM_NODES + 1), np.uint8)
    others = (lit & ~region) | seams
    dark = (~(lit | seams)).view(np.uint8)
    beside_dark = cv2.dilate(dark, reach, borderValue=1) > 0
    return others & beside_dark & (cv2.dilate(region.view(np.uint8), reach) > 0)


def edges(
    region: NDArray[np.bool_],
    seams: NDArray[np.bool_],
    rough: NDArray[np.float32],
    grid: Grid,
    period: float,
    faint: bool = False,
) -> NDArray[np.bool_]:
    """Nodes of a region where no smooth phase explains the photograph, gaps closed.

    Parameters
    ----------
    region, seams : ndarray, shape (rows, columns), bool
        The region, and nodes in it that were left out because they see two surfaces.
    rough : ndarray, shape (rows, columns), float32
        Misfit around each node, in fringe amplitudes.
    grid : Grid
    period : float
        Of the fringes, pixels.
    faint : bool
        Take faint edges too, which dents and glare may also leave.
    """
    inner = eroded(region | seams)
    if not inner.any():
        return inner
    sample = rough[::2, ::2][inner[::2, ::2]]
    typical = median(sample) if len(sample) else 0.0
    least = max(_FAINT * _ROUGH if faint else _ROUGH, _ROUGH_NOISE * typical)
    edge: Any = (inner & (rough > least)).view(np.uint8)
    lines = edge
    if edge.any():
        gap = _FAINT_GAP if faint else _GAP
        along_u, along_v = (int(gap * period / pitch) for pitch in grid.pitch)
        for shape, line in (((1, along_u), (1, _LINE)), ((along_v, 1), (_LINE, 1))):
            # So wide gaps are closed along lines only, not from one line to the next.
            ends = cv2.morphologyEx(edge, cv2.MORPH_OPEN, np.ones(line)) if faint else edge
            lines = lines | cv2.morphologyEx(ends, cv2.MORPH_CLOSE, np.ones(shape, np.uint8))
        lines = cv2.dilate(lines, np.ones((3, 3), np.uint8))
    return lines > 0


def separated(region: NDArray[np.bool_], lines: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The nodes of a region, cut along lines and at its necks."""
    labels: Any
    count, labels = cv2.connectedComponents(
        (eroded(region) & ~lines).view(np.uint8), connectivity=4
    )
    sizes = np.bincount(labels.ravel())
    grown: Any
    met: Any
    grown, met = np.zeros(region.shape, np.uint8), np.zeros(region.shape, np.uint8)
    size = 2 * _RIM_NODES + 1
    for label in range(1, count):
        if sizes[label] >= SMALLEST:
            core = (labels == label).view(np.uint8)
            grown = grown | cv2.dilate(core, np.ones((size, size), np.uint8))
            met = met + cv2.dilate(core, np.ones((size + 2, size + 2), np.uint8))
    return region & (grown > 0) & (met < 2)


def eroded(region: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The nodes of a region whose windows do not see its rim."""
    size = 2 * _RIM_NODES + 1
    return cv2.erode(region.view(np.uint8), np.ones((size, size), np.uint8), borderValue=0) > 0


def surfaces_in(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The nodes of a mask where it is wide enough for a surface, and those beside that see it.

    What is left out are strips, as fits leave them along the dark.
    """
    wide = eroded(mask)
    if not wide.any():
        return wide
    # Grown back to the surface, and on to the nodes whose windows it is in.
    size = 4 * _RIM_NODES + 1
    return mask & (cv2.dilate(wide.view(np.uint8), np.ones((size, size), np.uint8)) > 0)
