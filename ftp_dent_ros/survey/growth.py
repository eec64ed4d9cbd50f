"""Whether dents have grown between two surveys, so that noise is never a growth.

Every length, width and depth of every dent is a test, so that by chance alone some of hundreds lie
beyond any single test's limit: limits are those of Holm's step-down procedure (Scand. J. Statist.
6, 65, 1979) for all dents of a comparison together. What two surveys have in common (what the
reconstruction smooths, how an outline is drawn) drops out of their difference, which is therefore
less uncertain than both figures are stated to be: by how much is learnt from the dents themselves,
most of which have not grown. Where both surveys keep the skin about a dent, its depth's change is
that of the skin itself (`depth_growth`), and the factor on its uncertainty is learnt from such.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from ftp_dent_ros.dents.dent import Estimate, MeasuredDent
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.robust import NORMAL_SPREAD, median
from ftp_dent_ros.survey.result import SurveyedDent

# Chance that a comparison shows any change where there is none, and how it is shared out: depth is
# what grows first, and what manuals limit.
_FALSE_ALARM = 5e-3
_SHARE = {'depth': 0.9, 'length': 0.05, 'width': 0.05}
# What is known of the factor on stated uncertainties before there are dents, in degrees of freedom
# (it is 1, within a factor of two), and as how many at most all dents count: errors are not
# quite Gaussian far out.
_TRUST, _MOST = 4.0, 40.0
# Two calibrations' common factor on sizes, before there are dents: within 1 %.
_SCALE = 0.01

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """A quantity of a dent, later less earlier.

    Attributes
    ----------
    quantity : str
        depth, length or width.
    estimate : Estimate
        Metres; the two surveys' common factor is taken out.
    half : float
        Half the 95 % interval, metres.
    verdict : int
        1 grown, -1 shrunk, 0 neither is certain.
    """

    quantity: str
    estimate: Estimate
    half: float
    verdict: int


@dataclass(frozen=True)
class CommonFactor:
    """What two surveys have in common in one quantity: the factor of the later one's values.

    Attributes
    ----------
    quantity : str
    factor, uncertainty : float
    noise : float
        Factor on the stated uncertainties.
    freedom : float
        Degrees of freedom of that.
    """

    quantity: str
    factor: float
    uncertainty: float
    noise: float
    freedom: float


@dataclass(frozen=True)
class Growth:
    """How much deeper a dent is by the skin about it.

    Attributes
    ----------
    value, uncertainty : float
        Metres; of what stands out, how much farther it does.
    freedom : float
        Degrees of freedom of its uncertainty: how many places of the difference that are not
        correlated tell it, less what is fitted.
    noise : float
        Of the difference, as a mean over a square of one metre would have it, metres squared.
    """

    value: float
    uncertainty: float
    freedom: float
    noise: float


def changes_of(
    earlier: Sequence[MeasuredDent],
    later: Sequence[MeasuredDent],
    deeper: Sequence[Growth | None],
) -> tuple[list[tuple[Change, ...]], tuple[CommonFactor, ...]]:
    """Changes of dents that are the same, in their order, and the surveys' common factors.

    Parameters
    ----------
    earlier, later : sequence of MeasuredDent
        The same dents. One that is cut in either has no changes: its sizes are bounds.
    deeper : sequence of Growth or None
        Change of each dent's depth, where the skins themselves tell it.
    """
    usable = np.array([not (a.is_cut or b.is_cut) for a, b in zip(earlier, later, strict=True)])
    changes: list[list[Change]] = [[] for _ in earlier]
    factors = []
    for quantity in _SHARE:
        given = deeper if quantity == 'depth' else [None] * len(earlier)
        sizes = [
            np.array([[abs(e.value), e.uncertainty] for e in (getattr(d, quantity) for d in each)])
            for each in (earlier, later)
        ]
        factor, found = _changes(quantity, sizes[0], sizes[1], given, usable)
        factors.append(factor)
        for index, change in found.items():
            changes[index].append(change)
    return [tuple(each) for each in changes], tuple(factors)


def _changes(
    quantity: str,
    earlier: Array,
    later: Array,
    given: Sequence[Growth | None],
    usable: NDArray[np.bool_],
) -> tuple[CommonFactor, dict[int, Change]]:
    """Changes of values and their uncertainties, shape (n, 2), by the number of the dent."""
    before, after = earlier[:, 0], later[:, 0].copy()
    stated = np.hypot(earlier[:, 1], later[:, 1])
    freedom = np.full(len(before), math.inf)
    by_skin = np.array([each is not None for each in given], bool)
    usual = median(np.array([each.noise for each in given if each is not None] or [0.0]))
    for index, each in enumerate(given):
        if each is not None:
            after[index] = before[index] + each.value
            # A few places may be quieter than the surveys' skins are by chance alone; what is less
            # than the last number, metres squared, is no noise at all.
            stated[index] = each.uncertainty * max(1.0, usual / max(each.noise, 1e-15))
            freedom[index] = each.freedom
    known = usable & np.isfinite(before) & np.isfinite(after) & (stated > 0)
    change, uncertainty = np.full((2, len(before)), math.nan)
    factors = []
    for part in (by_skin, ~by_skin):
        some = known & part
        common = _common_factor(quantity, before[some], after[some], stated[some])
        change[part] = after[part] / common.factor - before[part]
        uncertainty[part] = np.hypot(
            common.noise * stated[part], before[part] * common.uncertainty
        )
        freedom[part] = np.minimum(freedom[part], common.freedom)
        factors.append((int((usable & part).sum()), common))
    whole = np.flatnonzero(usable)
    chances = 2 * student.sf(np.abs(change[whole]) / uncertainty[whole], freedom[whole])
    significant = whole[_holm(np.nan_to_num(chances, nan=1.0), _FALSE_ALARM * _SHARE[quantity])]
    # A growth is as uncertain as its dent's depth is, too: windows take of both alike.
    scale = np.where(by_skin, change * earlier[:, 1] / before, 0.0)
    uncertainty = np.hypot(uncertainty, scale)
    half = student.ppf(0.975, freedom) * uncertainty
    most = factors[0] if factors[0][0] > factors[1][0] else factors[1]
    return most[1], {
        k: Change(
            quantity,
            Estimate(float(change[k]), float(uncertainty[k])),
            float(half[k]),
            int(np.sign(change[k])) if k in significant else 0,
        )
        for k in whole.tolist()
    }


def _common_factor(quantity: str, before: Array, after: Array, stated: Array) -> CommonFactor:
    """Factor of later over earlier values, and that on their noise."""
    factor, spread, noise, freedom = 1.0, _SCALE, 1.0, _TRUST
    for _ in range(20 if len(before) else 0):
        off = (after - factor * before) / stated
        # Standard deviations beyond which a dent has changed.
        unchanged = np.abs(off) < 3.0 * max(NORMAL_SPREAD * float(np.median(np.abs(off))), 0.1)
        count = int(unchanged.sum())
        noise = float(np.sqrt((_TRUST + (off[unchanged] ** 2).sum()) / (_TRUST + count)))
        freedom = min(_TRUST + count, _MOST)
        # Those that have grown are far off, and weigh little.
        weight = 1 / ((noise * stated) ** 2 * (1 + (off / noise) ** 2 / 4))
        information = float((weight * before**2).sum()) + _SCALE**-2
        factor = (float((weight * before * after).sum()) + _SCALE**-2) / information
        spread = information**-0.5
    return CommonFactor(quantity, factor, spread, noise, freedom)


def _holm(chances: Array, together: float) -> NDArray[np.intp]:
    """Which tests are significant, all together to a chance."""
    order = np.argsort(chances)
    within = chances[order] <= together / np.arange(len(chances), 0, -1)
    return order[np.logical_and.accumulate(within)]


def depth_growth(earlier: SurveyedDent, later: SurveyedDent, to_later: Pose) -> Growth | None:
    """Depth of a dent in the later survey less that in the earlier one.

    Parameters
    ----------
    earlier, later : SurveyedDent
        The same dent.
    to_later : Pose
        Of the earlier survey's frame in the later one's, about the dent.

    Returns
    -------
    Growth or None
        None where not both surveys keep the skin about it.
    """
    growth, slide = None, np.zeros(2)
    # Steps in which it is found how far off the later skin lies.
    for _ in range(3):
        fitted = _fitted(earlier, later, to_later, slide)
        if fitted is None:
            return None
        growth, slide = fitted[0], slide + fitted[1]
    return growth


def _fitted(
    earlier: SurveyedDent, later: SurveyedDent, to_later: Pose, slide: Array
) -> tuple[Growth, Array] | None:
    """Growth, and how far off the later skin lies from where it is taken, along and across."""
    if earlier.relief is None or later.relief is None:
        return None
    dent, spacing = earlier.dent, earlier.relief.spacing
    a, b = earlier.relief.places()
    before = earlier.relief.heights.astype(float)
    # Heights of the later skin above the plane of the earlier dent.
    across = np.cross(dent.normal, dent.axis)
    aside = (a + slide[0])[..., None] * dent.axis + (b + slide[1])[..., None] * across
    after = later.relief.above(to_later.apply(dent.position + aside), later.dent)
    far = np.hypot(2 * a / dent.length.value, 2 * b / dent.width.value)
    known = np.isfinite(before) & np.isfinite(after)
    # Times the ellipse of the dent's sizes, from which on the skin is undeformed.
    ring = known & (far > 1.25)
    # Of the dent's points, that both surveys must have; and so many beside it, by those of the
    # dent.
    if known[far < 1].mean() < 0.95 or ring.sum() < 0.3 * (far < 1).sum():
        return None
    mean = np.where(known, (before + after) / 2, np.nan)
    x, y = a / np.abs(a).max(), b / np.abs(b).max()
    contour = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    deep = contour @ np.linalg.lstsq(contour[ring], mean[ring], rcond=None)[0] - mean
    form = deep / (0.5 * (dent.depth.value + later.dent.depth.value))
    down, along = np.gradient(mean, spacing)
    slopes = np.stack([along, down], axis=-1)
    used = known & np.isfinite(slopes).all(axis=-1)
    steepest = np.linalg.norm(slopes, axis=-1)[used].max()
    terms = np.concatenate([-form[..., None], slopes / steepest], axis=-1)
    terms = np.concatenate([terms, contour[..., :3]], axis=-1)[used]
    inverse = np.linalg.pinv(terms)
    off = (after - before)[used]
    fit = inverse @ off
    rest = np.zeros(used.shape)
    rest[used] = off - terms @ fit
    area = _correlated_points(rest, used)
    places = float(used.sum()) / area
    freedom = max(places - terms.shape[1], 1.0)
    noise = math.sqrt(float(rest[used].var()) * places / freedom * area)
    uncertainty = noise * math.sqrt(float((inverse[0] ** 2).sum()))
    growth = float(np.sign(dent.depth.value) * fit[0])
    return Growth(growth, uncertainty, freedom, noise * spacing), -fit[1:3] / steepest


def _correlated_points(rest: Array, used: NDArray[np.bool_]) -> float:
    """Points over which a difference is correlated: the sum of its correlations."""
    shape = [2 * size for size in rest.shape]
    both, covariance = (
        np.fft.irfft2(np.abs(np.fft.rfft2(values, shape)) ** 2, shape)
        for values in (used.astype(float), rest)
    )
    covariance = covariance / np.maximum(both, 1)
    down, across = (np.abs(np.fft.fftfreq(size, 1 / size)) for size in shape)
    # Within so much of the relief what its points differ by is correlated at most.
    near = np.hypot(down[:, None], across) < 0.25 * min(rest.shape)
    return float(np.maximum(covariance[near & (both > 0.5)] / covariance[0, 0], 0).sum())
