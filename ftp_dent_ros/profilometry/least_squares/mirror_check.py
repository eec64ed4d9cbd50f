"""Whether a photograph can be the right way round: mirrored, a smooth skin reads as no such.

Fringes about a stripe are their own mirror image. But where the projector looks askew at what
the camera sees, they crowd to one side on a smooth skin; read the other way round, that is taken
for a bend that no quadric follows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.profilometry.least_squares.fit.quadric import evaluate, robust_quadric
from ftp_dent_ros.profilometry.lit_area import LitArea
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Points that surfaces are compared by, about, and that there must be.
_POINTS, _LEAST = 400, 50
# Share of the distance by which a skin is off its quadric, beyond which it may be another way
# round; and how many times nearer to its quadric the mirrored one must be: none is by chance.
_OFF, _TIMES = 1e-3, 10.0


def check_upright(area: LitArea, off: float = _OFF) -> None:
    """Raise if the surface is a smooth skin were the photograph mirrored, and none as it is.

    Parameters
    ----------
    area : LitArea
    off : float
        Share of the distance by which a smooth skin is off its quadric at most.

    Raises
    ------
    OtherPatternError
    """
    flat = np.flatnonzero(area.lit)
    row, column = np.divmod(flat[:: max(1, len(flat) // _POINTS)], area.lit.shape[1])
    u_p = area.u_p(row, column)
    told = _off_quadric(area, area.rays[row, column, :2], u_p)
    if not told > off:
        return
    mirrored = 2 * area.pattern.stripe_center_px - u_p
    if told > _TIMES * _off_quadric(area, area.rays[row, -1 - column, :2], mirrored):
        raise OtherPatternError(
            f'the surface would be off any smooth shape by {told:.2%} of its distance, and would '
            'be a smooth skin if the photograph were mirrored: do not mirror or turn the '
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
    inverse = 1 / depth[0, met]
    quadric = robust_quadric(whole[0, met, :2], inverse)
    shape = evaluate(quadric, whole[0, met, :2][None])[0]
    return NORMAL_SPREAD * median(np.abs(inverse - shape) / np.abs(inverse))
