"""Whether a photograph can be the right way round: mirrored, a smooth skin reads as no such.

Fringes about a stripe are their own mirror image. But where the projector looks askew at what
the camera sees, they crowd to one side on a smooth skin; read the other way round, that is taken
for a bend that no quadric follows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.profilometry.lit_area import LitArea
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.robust import cauchy, deviation

# Points that surfaces are compared by, about, and that there must be.
_POINTS, _LEAST = 400, 50
# How many times nearer to its quadric the mirrored surface must be: none is by chance.
_TIMES = 10.0
# Fits of a quadric, each with the weights of what the last one left, by so many deviations.
_FITS, _REDESCENDS = 6, 4.0


def check_upright(area: LitArea, off: float) -> None:
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
    seen = _off_quadric(area, area.rays[row, column, :2], u_p)
    if not seen > off:
        return
    mirrored = 2 * area.pattern.stripe_center_px - u_p
    if seen > _TIMES * _off_quadric(area, area.rays[row, -1 - column, :2], mirrored):
        raise OtherPatternError(
            f'the surface would be off any smooth shape by {seen:.2%} of its distance, and would '
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
    inverse = 1 / depth[0, met].astype(float)
    x, y = rays[met].T.astype(float)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    root = np.ones(len(x))  # of the weights of Geman and McClure's function
    for _ in range(_FITS):
        quadric = np.linalg.lstsq(root[:, None] * terms, root * inverse, rcond=None)[0]
        rest = inverse - terms @ quadric
        root = cauchy(rest, _REDESCENDS * max(deviation(rest), 1e-9))
    return deviation(rest / inverse)
