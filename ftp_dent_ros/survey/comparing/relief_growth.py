"""How much deeper a dent is in a later survey, by the difference of both skins about it.

What both surveys have in common (what windows smooth of the dent, the reference contour, how an
outline is drawn) is in neither's difference. What is left of two skins that lie on each other is a
plane, a slide along the skin, which shows as the skin's slopes, and the dent's own form, as much
deeper as it has grown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import Estimate
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.patches.resampling import remap
from ftp_dent_ros.survey.result import SurveyedDent

Array = NDArray[np.float64]

# Times the ellipse of the dent's sizes, from which on the skin is undeformed.
_OUTSIDE = 1.25
# Of the dent's points, that both surveys must have; and so many beside it, by those of the dent.
_LEAST_SHARE, _LEAST_BESIDE = 0.95, 0.3
# Steps in which a slide is found.
_ROUNDS = 3
# Within so much of the relief what its points differ by is correlated at most.
_CORRELATED = 0.25


@dataclass(frozen=True)
class Growth:
    """How much deeper a dent is.

    Attributes
    ----------
    estimate : Estimate
        Metres, inward positive.
    freedom : float
        Degrees of freedom of its uncertainty: how many places of the difference that are not
        correlated tell it, less what is fitted.
    noise : float
        Of the difference, as a mean over a square of one metre would have it, metres squared.
    """

    estimate: Estimate
    freedom: float
    noise: float


def growth_of(earlier: SurveyedDent, later: SurveyedDent, to_later: Pose) -> Growth | None:
    """Depth of a dent in the later survey less that in the earlier one, metres, inward positive.

    Parameters
    ----------
    earlier, later : SurveyedDent
        The same dent.
    to_later : Pose
        Of the earlier survey's frame in the later one's, about the dent.

    Returns
    -------
    Growth or None
        None where not both surveys tell of the skin about it.
    """
    if earlier.relief is None or later.relief is None:
        return None
    slide, found = np.zeros(2), None
    for _ in range(_ROUNDS):
        found = _fitted(earlier, later, to_later, slide)
        if found is None:
            return None
        slide = slide + found[1]
    assert found is not None
    return found[0]


def _fitted(
    earlier: SurveyedDent, later: SurveyedDent, to_later: Pose, slide: Array
) -> tuple[Growth, Array] | None:
    """Growth, and how far off the later skin lies from where it is taken, along and across."""
    assert earlier.relief is not None
    a, b = earlier.relief.places()
    before = earlier.relief.heights.astype(float)
    after = _after(earlier, later, to_later, a + slide[0], b + slide[1])
    dent = earlier.dent
    far = np.hypot(2 * a / dent.length.value, 2 * b / dent.width.value)
    known = np.isfinite(before) & np.isfinite(after)
    ring = known & (far > _OUTSIDE)
    if known[far < 1].mean() < _LEAST_SHARE or ring.sum() < _LEAST_BESIDE * (far < 1).sum():
        return None
    mean = np.where(known, (before + after) / 2, np.nan)
    x, y = a / np.abs(a).max(), b / np.abs(b).max()
    contour = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    deep = contour @ np.linalg.lstsq(contour[ring], mean[ring], rcond=None)[0] - mean
    form = deep / (0.5 * (dent.depth.value + later.dent.depth.value))
    along, across = np.gradient(mean, earlier.relief.spacing)[::-1]
    used = known & np.isfinite(along) & np.isfinite(across)
    steepest = np.hypot(along, across)[used].max()
    terms = np.stack([-form, along / steepest, across / steepest], axis=-1)
    terms = np.concatenate([terms, contour[..., :3]], axis=-1)[used]
    inverse = np.linalg.pinv(terms)
    off = (after - before)[used]
    fit = inverse @ off
    rest = np.zeros(used.shape)
    rest[used] = off - terms @ fit
    area = _correlated(rest, used)
    places = float(used.sum()) / area
    freedom = max(places - terms.shape[1], 1.0)
    noise = math.sqrt(float(rest[used].var()) * places / freedom * area)
    estimate = Estimate(float(fit[0]), noise * math.sqrt(float((inverse[0] ** 2).sum())))
    noise *= earlier.relief.spacing
    return Growth(estimate, freedom, noise), -fit[1:3] / steepest


def _after(
    earlier: SurveyedDent, later: SurveyedDent, to_later: Pose, a: Array, b: Array
) -> Array:
    """Heights of the later skin above the plane of the earlier dent, at places in it."""
    relief = later.relief
    assert relief is not None
    ours, theirs = earlier.dent, later.dent
    across = np.cross(ours.normal, ours.axis)
    plane = ours.position + a[..., None] * ours.axis + b[..., None] * across
    off = to_later.apply(plane) - theirs.position
    rows, columns = relief.heights.shape
    u = off @ theirs.axis / relief.spacing + columns // 2
    v = off @ np.cross(theirs.normal, theirs.axis) / relief.spacing + rows // 2
    heights = remap(relief.heights, u.astype(np.float32), v.astype(np.float32), cv2.INTER_CUBIC)
    return heights - off @ theirs.normal


def _correlated(rest: Array, used: NDArray[np.bool_]) -> float:
    """Points over which a difference is correlated: the sum of its correlations."""
    shape = [2 * size for size in rest.shape]

    def with_itself(values: Array) -> Array:
        return np.fft.irfft2(np.abs(np.fft.rfft2(values, shape)) ** 2, shape)

    both = with_itself(used.astype(float))
    covariance = with_itself(rest) / np.maximum(both, 1)
    down, across = (np.abs(np.fft.fftfreq(size, 1 / size)) for size in shape)
    near = np.hypot(down[:, None], across) < _CORRELATED * min(rest.shape)
    return float(np.maximum(covariance[near & (both > 0.5)] / covariance[0, 0], 0).sum())
