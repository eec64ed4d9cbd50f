"""One patch laid on another: least squares on heights along the normal and paint along the skin.

The point-to-plane distance uses the clouds' own slopes (Chen and Medioni, 1992), the paint its
gradients (Lucas and Kanade, 1981). Noise has slopes too: counted as if they were the skin's, they
would make every smooth panel seem to tell its place. So what is known of a direction is summed
from products of one patch's slopes with the other's, in which noise cancels and only what both
show remains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import Array, cross
from ftp_dent_ros.robust import cauchy, deviation
from ftp_dent_ros.survey.patch import Samples, SkinPatch
from ftp_dent_ros.survey.raster import Grid

APART = 'they do not overlap'


class UnlikePairError(Exception):
    """Two clouds that do not lie on each other; the message says in what."""


@dataclass(frozen=True, eq=False)
class PairEquations:
    """Linearised residuals at a pose, of the n points that lie on the other patch.

    Attributes
    ----------
    residual : ndarray, shape (n,)
        In standard deviations.
    own, other : ndarray, shape (n, 6)
        Change with the shift of the centre and the turn about it, by either patch's slopes, in
        standard deviations.
    weight : ndarray, shape (n,)
        Of Cauchy, 0 to 1: a half at 2.385 standard deviations.
    place : ndarray, shape (n, 3)
        On the first patch, metres.
    spread : float
        Standard deviation of heights by what the clouds state, and of paint alone its own.
    """

    residual: Array
    own: Array
    other: Array
    weight: Array
    place: Array
    spread: float

    @cached_property
    def both(self) -> Array:
        """Change by the mean of both patches' slopes, shape (n, 6)."""
        return (self.own + self.other) / 2


def of_heights(first: SkinPatch, second: Samples, pose: Pose, centre: Array) -> PairEquations:
    """Equations of the heights alone.

    Raises
    ------
    UnlikePairError
        Hardly any lie on the other patch.
    """
    place = pose.apply(second.heights)
    here = first.below(place)
    met = np.isfinite(here[:, 0])
    # Of a pose's six unknowns, each by several.
    if met.sum() < 50:
        raise UnlikePairError(APART)
    place, here, there = place[met], here[met].astype(float), second.height_values[met]
    own, other = (np.column_stack([-each[:, 1:3], np.ones(len(each))]) for each in (here, there))
    other = other @ pose.rotation.as_matrix().T
    own, other = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (own, other))
    # No two clouds fit each other better, metres.
    sigma = np.maximum(np.hypot(here[:, 3], there[:, 3]), 2e-6)
    off = (place[:, 2] - here[:, 0]) * own[:, 2] / sigma
    # Clouds may be surer of themselves than they fit.
    spread = max(1.0, deviation(off))
    slopes = [each / (sigma * spread)[:, None] for each in (own, other)]
    return _linearised(off / spread, slopes, place - centre, place, spread)


def painted(first: SkinPatch, second: Samples, pose: Pose) -> tuple[Grid, NDArray[np.bool_]]:
    """Paint below samples, shape (n, 4), and where both are known, (n,)."""
    below = first.looked_up(first.paints[0], pose.apply(second.paint))
    return below, (below[:, 3] > 0.99) & (second.paint_values[:, 3] > 0)


def equations(first: SkinPatch, second: Samples, pose: Pose, centre: Array) -> PairEquations:
    """Equations of heights and paint at a pose of the second patch in the first."""
    heights = of_heights(first, second, pose, centre)
    here, met = painted(first, second, pose)
    place = pose.apply(second.paint)[met]
    ours, theirs = here[met].astype(float), second.paint_values[met].astype(float)
    off = ours[:, 0] - theirs[:, 0]
    # No two paints fit each other better.
    spread = max(deviation(off) if len(off) else 1.0, 1e-3)
    theirs = theirs[:, 1:3] @ pose.rotation.as_matrix()[:, :2].T
    slopes = [each / spread for each in (ours[:, 1:3] @ np.eye(2, 3), theirs)]
    paint = _linearised(off / spread, slopes, place - centre, place, spread)
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(each, name) for each in (heights, paint)])
        for name in ('residual', 'own', 'other', 'weight', 'place')
    }
    return replace(heights, **joined)


def _linearised(
    residual: Array, slopes: list[Array], arm: Array, place: Array, spread: float
) -> PairEquations:
    """Residuals that change by slopes as what lies at the end of arms shifts and turns."""
    own, other = (np.hstack([each, cross(arm, each)]) for each in slopes)
    weight = cauchy(residual, 2.385)
    return PairEquations(residual, own, other, weight, place, spread)
