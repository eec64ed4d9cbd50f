"""Whether dents have grown between two surveys, so that noise is never a growth.

Every length, width and depth of every dent is a test, so that by chance alone some of hundreds lie
beyond any single test's limit: each is held against the chance for all dents of a comparison
together, over their number (Bonferroni). What two surveys have in common (what the
reconstruction smooths, how an outline is drawn) drops out of their difference, which is therefore
less uncertain than both figures are stated to be: by how much is learnt from the dents themselves,
most of which have not grown. Where both surveys keep the skin about a dent, its depth's change is
that of the skin itself (`depth_growth`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate
from scipy.special import stdtr, stdtrit

from ftp_dent_ros.dents.dent import Estimate, MeasuredDent
from ftp_dent_ros.rigid import Array
from ftp_dent_ros.robust import deviation
from ftp_dent_ros.survey.result import SurveyedDent

# Chance that a comparison shows a change where there is none, 0.005 in all: depth is what grows
# first, and what manuals limit.
_FALSE_ALARM = {'depth': 5e-3 * 0.9, 'length': 5e-3 * 0.05, 'width': 5e-3 * 0.05}
# What is known of the factor on stated uncertainties before there are dents, in degrees of freedom
# (it is 1, within a factor of two).
_TRUST = 4.0
# Two calibrations' common factor on sizes, before there are dents: within 1 %.
_SCALE = 0.01


@dataclass(frozen=True)
class Change:
    """A quantity of a dent, later less earlier.

    Attributes
    ----------
    estimate : Estimate
        Metres; the two surveys' common factor is taken out.
    half : float
        Half the 95 % interval, metres.
    verdict : int
        1 grown, -1 shrunk, 0 neither is certain.
    """

    estimate: Estimate
    half: float
    verdict: int


def changes_of(
    earlier: Sequence[MeasuredDent], later: Sequence[MeasuredDent], deeper: Sequence[Array]
) -> tuple[list[dict[str, Change]], dict[str, Estimate]]:
    """Changes of dents that are the same, in their order, and the later values' common factors.

    Both are by the quantity: depth, length and width.

    Parameters
    ----------
    earlier, later : sequence of MeasuredDent
        The same dents. One that is cut in either has no changes: its sizes are bounds.
    deeper : sequence of ndarray, shape (3,)
        Of each dent, as of `depth_growth`.
    """
    usable = np.array([not (a.is_cut or b.is_cut) for a, b in zip(earlier, later, strict=True)])
    factors, found, unknown = {}, {}, np.full((len(earlier), 3), math.nan)
    for quantity, chance in _FALSE_ALARM.items():
        before, after = (
            np.array([[abs(e.value), e.uncertainty] for e in (getattr(d, quantity) for d in each)])
            for each in (earlier, later)
        )
        given = np.reshape(deeper if quantity == 'depth' else unknown, (-1, 3))
        factors[quantity], found[quantity] = _changes(chance, before, after, given, usable)
    return [
        {quantity: each[k] for quantity, each in found.items() if k in each}
        for k in range(len(earlier))
    ], factors


def _changes(
    false_alarm: float, earlier: Array, later: Array, given: Array, usable: NDArray[np.bool_]
) -> tuple[Estimate, dict[int, Change]]:
    """Changes of values and their uncertainties, shape (n, 2), by the number of the dent."""
    before, after = earlier[:, 0], later[:, 0]
    growth, spread, freedom = given.T
    by_skin = np.isfinite(growth)
    after = np.where(by_skin, before + growth, after)
    stated = np.where(by_skin, spread, np.hypot(earlier[:, 1], later[:, 1]))
    freedom = np.where(by_skin, freedom, math.inf)
    known = usable & np.isfinite(before) & np.isfinite(after) & (stated > 0)
    factor, noise, most = _common_factor(before[known], after[known], stated[known])
    change, freedom = after / factor.value - before, np.minimum(freedom, most)
    uncertainty = np.hypot(noise * stated, before * factor.uncertainty)
    chances = 2 * stdtr(freedom, -np.abs(change) / uncertainty)
    # Of what is not known, none.
    is_certain = chances <= false_alarm / max(usable.sum(), 1)
    # A growth is as uncertain as its dent's depth is, too: windows take of both alike.
    scale = np.where(by_skin, change * earlier[:, 1] / before, 0.0)
    uncertainty = np.hypot(uncertainty, scale)
    half = stdtrit(freedom, 0.975) * uncertainty
    return factor, {
        k: Change(
            Estimate(float(change[k]), float(uncertainty[k])),
            float(half[k]),
            int(np.sign(change[k])) if is_certain[k] else 0,
        )
        for k in np.flatnonzero(usable).tolist()
    }


def _common_factor(before: Array, after: Array, stated: Array) -> tuple[Estimate, float, float]:
    """Factor of later over earlier values, that on their noise, and its degrees of freedom."""
    factor, spread, noise, freedom = 1.0, _SCALE, 1.0, _TRUST
    for _ in range(20 if len(before) else 0):
        off = (after - factor * before) / stated
        # Standard deviations beyond which a dent has changed.
        unchanged = np.abs(off) < 3.0 * max(deviation(off), 0.1)
        count = int(unchanged.sum())
        noise = float(np.sqrt((_TRUST + (off[unchanged] ** 2).sum()) / (_TRUST + count)))
        # As how many at most all dents count: errors are not quite Gaussian far out.
        freedom = min(_TRUST + count, 40.0)
        # Those that have grown are far off, and weigh little.
        weight = 1 / ((noise * stated) ** 2 * (1 + (off / noise) ** 2 / 4))
        information = float((weight * before**2).sum()) + _SCALE**-2
        factor = (float((weight * before * after).sum()) + _SCALE**-2) / information
        spread = information**-0.5
    return Estimate(factor, spread), noise, freedom


def depth_growth(earlier: SurveyedDent, later: SurveyedDent) -> Array:
    """Depth of a dent in the later survey less that in the earlier one, by the skin about it.

    Parameters
    ----------
    earlier, later : SurveyedDent
        The same dent, in one frame.

    Returns
    -------
    ndarray, shape (3,)
        By how much it is deeper, or higher, and the uncertainty of that, metres; its degrees of
        freedom: how many places of the difference that are not correlated tell it, less what is
        fitted. NaN where not both surveys keep the skin about it.
    """
    unknown = np.full(3, math.nan)
    if earlier.relief is None or later.relief is None:
        return unknown
    dent, (a, b) = earlier.dent, earlier.relief.places()
    before = earlier.relief.heights.astype(float)
    far = np.hypot(2 * a / dent.length.value, 2 * b / dent.width.value)
    contour = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=-1)
    # How far off the later skin lies, along and across, is found in some steps.
    slide, growth = np.zeros(2), unknown
    for _ in range(3):
        # Heights of the later skin above the plane of the earlier dent.
        after = later.relief.above(earlier.relief.plane(dent, slide), later.dent)
        known = np.isfinite(before) & np.isfinite(after)
        # Times the ellipse of the dent's sizes, from which on the skin is undeformed.
        ring = known & (far > 1.25)
        # Of the dent's points, that both surveys must have; and so many beside it, by those of
        # the dent.
        if known[far < 1].mean() < 0.95 or ring.sum() < 0.3 * (far < 1).sum():
            return unknown
        mean = np.where(known, (before + after) / 2, np.nan)
        deep = contour @ np.linalg.lstsq(contour[ring], mean[ring], rcond=None)[0] - mean
        form = deep / (0.5 * (dent.depth.value + later.dent.depth.value))
        down, along = np.gradient(mean, earlier.relief.spacing)
        terms = np.dstack([-form, along, down, contour[..., :3]])
        used = known & np.isfinite(terms).all(axis=-1)
        inverse, off = np.linalg.pinv(terms[used]), (after - before)[used]
        fit, rest = inverse @ off, np.zeros(used.shape)
        rest[used] = off - terms[used] @ fit
        places = float(used.sum()) / _correlated_points(rest, used.astype(float))
        freedom = max(places - len(fit), 1.0)
        uncertainty = math.sqrt(np.square(rest).sum() / freedom) * np.linalg.norm(inverse[0])
        growth = np.array([np.sign(dent.depth.value) * fit[0], uncertainty, freedom])
        slide = slide - fit[1:3]
    return growth


def _correlated_points(rest: Array, used: Array) -> float:
    """Points over which a difference is correlated: the sum of its correlations."""
    both = correlate(used, used, method='fft')
    covariance = correlate(rest, rest, method='fft') / np.maximum(both, 1)
    middle = np.array(rest.shape) - 1
    down, across = np.indices(both.shape) - middle[:, None, None]
    # Within so much of the relief what its points differ by is correlated at most.
    near = np.hypot(down, across) < 0.25 * min(rest.shape)
    shares = covariance[near & (both > 0.5)] / covariance[tuple(middle)]
    return float(np.maximum(shares, 0).sum())
