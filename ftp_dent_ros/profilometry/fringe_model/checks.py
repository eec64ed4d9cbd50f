"""Whether a photograph can be of this pattern and rig: the light's rims, the rows, the shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.epipolar_check import EpipolarCheck, check_epipolar
from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, BinGrid
from ftp_dent_ros.profilometry.fringe_model.quadric import Quadric
from ftp_dent_ros.profilometry.fringe_model.solver import FringeFit
from ftp_dent_ros.profilometry.least_squares.phase_geometry import PhaseGeometry
from ftp_dent_ros.profilometry.lit_area import LitArea
from ftp_dent_ros.profilometry.pattern_check import check_pattern, other_frame
from ftp_dent_ros.profilometry.projector_rows import Rows
from ftp_dent_ros.profilometry.rows_check import check_rows
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Share of a node's bins that must be measured where rows are read.
_ALL = 0.99
# Points that surfaces are compared by, about, and that there must be.
_POINTS, _LEAST = 400, 50
# Share of the distance that a smooth skin is off its quadric by noise, at most; and how many times
# nearer to its quadric the mirrored one must be: none is by chance.
_OFF, _TIMES = 2e-4, 10.0

Surfaces = Sequence[tuple[NDArray[np.float32], NDArray[np.bool_]]]


def check_surfaces(
    area: LitArea, grid: BinGrid, fit: FringeFit, found: Surfaces
) -> tuple[bool, EpipolarCheck | None]:
    """Check the pattern by the rims of its light, and the rig by the projector's rows.

    Parameters
    ----------
    area : LitArea
    grid : BinGrid
    fit : FringeFit
    found : sequence of (ndarray, ndarray), shape (rows, columns)
        Phase of each surface at the bins, and where it is measured.

    Returns
    -------
    confirmed : bool
        Whether the photograph itself shows that the pattern is this one.
    epipolar : EpipolarCheck or None
        None where the pattern does not tell its rows, or too little of it is seen.

    Raises
    ------
    OtherPatternError
    """
    rig, pattern = area.rig, area.pattern
    confirmed = check_pattern(area)
    if pattern.code == 'stripe' and not confirmed:
        _check_upright(area)
    if not pattern.tells_rows:
        return confirmed, None
    window = WIDTH * pattern.period_px
    epipolar = check_epipolar(rig, pattern, _rows(rig, pattern, grid, fit, found), window)
    if epipolar is not None:
        other = other_frame(area)
        under = None
        if other is not None:
            under = check_epipolar(rig, other, _rows(rig, other, grid, fit, found), window)
        check_rows(pattern, epipolar, other, under)
    return confirmed, epipolar


def _rows(
    rig: Rig, pattern: Pattern, grid: BinGrid, fit: FringeFit, found: Surfaces
) -> list[Rows]:
    """What the surfaces show of the projector's rows under a pattern."""
    nodes = PhaseGeometry.of(rig, pattern, *grid.node_positions())
    contrast = grid.at_nodes(fit.amplitude) / np.maximum(grid.at_nodes(fit.level), 1)
    rows = []
    for phase, measured in found:
        at_nodes = grid.at_nodes(phase)
        seen = grid.at_nodes(measured.astype(np.float32)) > _ALL
        rows.append(
            Rows(pattern.column(at_nodes), nodes.meet(at_nodes)[1], contrast, seen, nodes.rays)
        )
    return rows


def _check_upright(area: LitArea) -> None:
    """Raise if the surface is a smooth skin were the photograph mirrored, and none as it is.

    Fringes about a stripe are their own mirror image. But where the projector looks askew at what
    the camera sees, they crowd to one side on a smooth skin; read the other way round, that is
    taken for a bend that no quadric follows.

    Raises
    ------
    OtherPatternError
    """
    flat = np.flatnonzero(area.lit)
    row, column = np.divmod(flat[:: max(1, len(flat) // _POINTS)], area.lit.shape[1])
    u_p = area.u_p(row, column)
    told_off = _off_quadric(area, area.rays[row, column, :2], u_p)
    if not told_off > _OFF:
        return
    mirrored = 2 * area.pattern.stripe_center_px - u_p
    if told_off > _TIMES * _off_quadric(area, area.rays[row, -1 - column, :2], mirrored):
        raise OtherPatternError(
            f'the surface would be off any smooth shape by {told_off:.2%} of its distance, and '
            'would be a smooth skin if the photograph were mirrored: do not mirror or turn the '
            'photograph, and give the rig that it is taken with (rig.yaml)'
        )


def _off_quadric(area: LitArea, rays: NDArray, u_p: NDArray) -> float:
    """How far points are from the quadric through them, over their distance; NaN if too few."""
    whole = np.ones((1, len(rays), 3), np.float32)
    whole[0, :, :2] = rays
    depth, _ = triangulate(area.rig, whole, u_p[None].astype(np.float32))
    met = np.isfinite(depth[0])
    if np.count_nonzero(met) < max(_LEAST, 0.9 * len(rays)):
        return np.nan
    x, y = whole[0, met, :2].T
    inverse = 1 / depth[0, met]
    off = Quadric.through(x, y, inverse).at(x, y) - inverse
    return NORMAL_SPREAD * median(np.abs(off) / np.abs(inverse))
