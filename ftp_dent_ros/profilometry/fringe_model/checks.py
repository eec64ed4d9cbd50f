"""Whether a photograph can be of this pattern and rig: the light's rims, the rows, the shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.epipolar_check import EpipolarCheck, check_epipolar
from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, BinGrid
from ftp_dent_ros.profilometry.fringe_model.solver import FringeFit
from ftp_dent_ros.profilometry.least_squares.mirror_check import check_upright
from ftp_dent_ros.profilometry.least_squares.phase_geometry import PhaseGeometry
from ftp_dent_ros.profilometry.lit_area import LitArea
from ftp_dent_ros.profilometry.pattern_check import check_pattern, other_frame
from ftp_dent_ros.profilometry.projector_rows import Rows
from ftp_dent_ros.profilometry.rows_check import check_rows
from ftp_dent_ros.rig.rig import Rig

# Share of the distance that a smooth skin is off its quadric by noise, at most.
_OFF = 2e-4

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
    found : sequence of (ndarray, ndarray), shape (rows, nodes)
        Phase of each surface at the nodes, and where it is measured.

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
        check_upright(area, _OFF)
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
        _, v_p = nodes.meet(phase)
        rows.append(Rows(pattern.column(phase), v_p, contrast, measured, nodes.rays))
    return rows
