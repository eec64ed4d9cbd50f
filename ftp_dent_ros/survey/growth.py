"""Whether dents have grown between two surveys, told so that noise is never a growth.

Every length, width and depth of every dent is a test, so that by chance alone some of hundreds lie
beyond any single test's limit: limits are those of Holm's step-down procedure (Scand. J. Statist.
6, 65, 1979) for all dents of a comparison together. What two surveys have in common (what the
reconstruction smooths, how an outline is drawn) drops out of their difference, which is therefore
less uncertain than both figures are stated to be: by how much is learnt from the dents themselves,
most of which have not grown. Where both surveys keep the skin about a dent, its depth's change is
that of the skin itself (`relief_growth`), and the factor on its uncertainty is learnt from such.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from ftp_dent_ros.dents.dent import Estimate, MeasuredDent
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.robust import NORMAL_SPREAD, median
from ftp_dent_ros.survey.resampling import remap
from ftp_dent_ros.survey.result import SurveyedDent

QUANTITIES = ('depth', 'length', 'width')
# Chance that a comparison tells any change where there is none, and how it is shared out: depth is
# what grows first, and what manuals limit.
FALSE_ALARM = 5e-3
_SHARE = {'depth': 0.9, 'length': 0.05, 'width': 0.05}
# What is known of the factor on stated uncertainties before there are dents, in degrees of freedom
# (it is 1, within a factor of two), and as how many at most all dents count: errors are not
# quite Gaussian far out.
_TRUST, _MOST = 4.0, 40.0
# Two calibrations' common factor on sizes, before there are dents: within 1 %.
_SCALE = 0.01
_ROUNDS = 20

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """A quantity of a dent, later less earlier.

    Attributes
    ----------
    quantity : str
        One of `QUANTITIES`.
    estimate : Estimate
        Metres; the two surveys' common factor is taken out.
    half : float
        Half the 95 % interval, metres.
    verdict : int
        1 grown, -1 shrunk, 0 neither can be told.
    """

    quantity: str
    estimate: Estimate
    half: float
    verdict: int


@dataclass(frozen=True)
class CommonFactor:
    """What two surveys have in common in one quantity: the factor of the later one's values."""

    quantity: str
    factor: float
    uncertainty: float
    noise: float  # on the stated uncertainties


def changes_of(
    earlier: Sequence[MeasuredDent],
    later: Sequence[MeasuredDent],
    deeper: Sequence[Growth | None] = (),
) -> tuple[list[tuple[Change, ...]], tuple[CommonFactor, ...]]:
    """Changes of dents that are the same, in their order, and the surveys' common factors.

    Parameters
    ----------
    earlier, later : sequence of MeasuredDent
        The same dents. One that is cut in either has no changes: its sizes are bounds.
    deeper : sequence of Growth or None, optional
        Change of each dent's depth, where the skins themselves tell it.
    """
    usable = np.array([not (a.is_cut or b.is_cut) for a, b in zip(earlier, later, strict=True)])
    known: dict[str, Sequence[Growth | None]] = {'depth': deeper or [None] * len(earlier)}
    scales, values, freedoms = [], {}, {}
    for quantity in QUANTITIES:
        one, two = (
            [_magnitude(getattr(dent, quantity)) for dent in dents] for dents in (earlier, later)
        )
        given = known.get(quantity, [None] * len(earlier))
        scale, values[quantity], freedoms[quantity] = _compared(quantity, one, two, given, usable)
        scales.append(scale)
    told = set()
    for quantity in QUANTITIES:
        indices = np.flatnonzero(usable)
        chances = [
            _chance(values[quantity][index], freedoms[quantity][index]) for index in indices
        ]
        significant = _holm(chances, FALSE_ALARM * _SHARE[quantity])
        told |= {(index, quantity) for index in indices[significant]}
    result = []
    for index in range(len(earlier)):
        found = []
        for quantity in QUANTITIES if usable[index] else ():
            estimate = values[quantity][index]
            sign = int(np.sign(estimate.value)) if (index, quantity) in told else 0
            if quantity == 'depth' and known['depth'][index] is not None:
                estimate = _with_scale(estimate, earlier[index].depth)
            half = float(student.ppf(0.975, freedoms[quantity][index]) * estimate.uncertainty)
            found.append(Change(quantity, estimate, half, sign))
        result.append(tuple(found))
    return result, tuple(scales)


def _compared(
    quantity: str,
    earlier: Sequence[Estimate],
    later: Sequence[Estimate],
    given: Sequence[Growth | None],
    usable: NDArray[np.bool_],
) -> tuple[CommonFactor, list[Estimate], list[float]]:
    """How most dents compare; each one's difference, and its degrees of freedom."""
    later = [
        b if d is None else Estimate(a.value + d.estimate.value, a.uncertainty)
        for a, b, d in zip(earlier, later, given, strict=True)
    ]
    directly = np.array([each is not None for each in given], bool)
    noise = median(np.array([each.noise for each in given if each is not None] or [0.0]))
    stated = np.array(
        [
            np.hypot(a.uncertainty, b.uncertainty) if d is None else _uncertainty(d, noise)
            for a, b, d in zip(earlier, later, given, strict=True)
        ]
    )
    by_skin, by_size = (
        _scale(quantity, earlier, later, stated, usable & part) for part in (directly, ~directly)
    )
    differences, freedoms = [], []
    for a, b, spread, direct in zip(earlier, later, stated, given, strict=True):
        scale, freedom = by_size if direct is None else by_skin
        differences.append(_difference(a, b, spread, scale))
        freedoms.append(freedom if direct is None else min(freedom, direct.freedom))
    most = by_skin if (usable & directly).sum() > (usable & ~directly).sum() else by_size
    return most[0], differences, freedoms


def _uncertainty(growth: Growth, usual: float) -> float:
    """Of a growth, whose few places may be quieter than the surveys' skins are by chance alone."""
    # Of a skin's difference, metres squared: what is less is none.
    return growth.estimate.uncertainty * max(1.0, usual / max(growth.noise, 1e-15))


def _with_scale(growth: Estimate, depth: Estimate) -> Estimate:
    """A growth as uncertain as its dent's depth is, too: windows take of both alike."""
    part = growth.value * depth.uncertainty / depth.value
    return Estimate(growth.value, float(np.hypot(growth.uncertainty, part)))


def _magnitude(estimate: Estimate) -> Estimate:
    """A bump grows outward."""
    return Estimate(abs(estimate.value), estimate.uncertainty)


def _scale(
    quantity: str,
    earlier: Sequence[Estimate],
    later: Sequence[Estimate],
    stated: NDArray[np.float64],
    usable: NDArray[np.bool_],
) -> tuple[CommonFactor, float]:
    """Factor of later over earlier values, the factor on their noise, and its freedom."""
    a, b = (np.array([[e.value, e.uncertainty] for e in each]) for each in (earlier, later))
    known = usable & np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    known &= stated > 0
    a, b, stated = a[known], b[known], stated[known]
    factor, spread, noise, freedom = 1.0, _SCALE, 1.0, _TRUST
    for _ in range(_ROUNDS if len(a) else 0):
        off = (b[:, 0] - factor * a[:, 0]) / stated
        # Standard deviations beyond which a dent has changed.
        unchanged = np.abs(off) < 3.0 * max(NORMAL_SPREAD * float(np.median(np.abs(off))), 0.1)
        count = int(unchanged.sum())
        noise = float(np.sqrt((_TRUST + (off[unchanged] ** 2).sum()) / (_TRUST + count)))
        freedom = min(_TRUST + count, _MOST)
        # Those that have grown are far off, and weigh little.
        weight = 1 / ((noise * stated) ** 2 * (1 + (off / noise) ** 2 / 4))
        information = float((weight * a[:, 0] ** 2).sum()) + _SCALE**-2
        factor = (float((weight * a[:, 0] * b[:, 0]).sum()) + _SCALE**-2) / information
        spread = information**-0.5
    return CommonFactor(quantity, factor, spread, noise), freedom


def _difference(
    earlier: Estimate, later: Estimate, stated: float, scale: CommonFactor
) -> Estimate:
    value = later.value / scale.factor - earlier.value
    noise = scale.noise * stated
    return Estimate(value, float(np.hypot(noise, earlier.value * scale.uncertainty)))


def _chance(change: Estimate, freedom: float) -> float:
    """That noise alone is as far from nothing, to either side; 1 where it is not known."""
    if not (np.isfinite(change.value) and change.uncertainty > 0):
        return 1.0
    return float(2 * student.sf(abs(change.value) / change.uncertainty, freedom))


def _holm(chances: Sequence[float], together: float) -> NDArray[np.bool_]:
    """Which tests are significant, all together to a chance."""
    order = np.argsort(chances)
    significant = np.zeros(len(chances), bool)
    for rank, index in enumerate(order):
        if chances[index] > together / (len(chances) - rank):
            break
        significant[index] = True
    return significant


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


def depth_growth(earlier: SurveyedDent, later: SurveyedDent, to_later: Pose) -> Growth | None:
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
    # Steps in which a slide is found.
    for _ in range(3):
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
    # Within so much of the relief what its points differ by is correlated at most.
    near = np.hypot(down[:, None], across) < 0.25 * min(rest.shape)
    return float(np.maximum(covariance[near & (both > 0.5)] / covariance[0, 0], 0).sum())
