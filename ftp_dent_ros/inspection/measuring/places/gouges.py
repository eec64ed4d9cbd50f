"""Grooves under narrow light marks: gouges, and scratches, which are shallow ones.

A groove of few millimetres is hardly deeper in the cloud than the cloud is in doubt beside paint,
and narrower than the dents that are looked for. Its mark tells where it would be, how long and how
wide: one depth is left to be asked for, of the points along all of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.inspection.dent import Estimate, MeasuredDent, orientation_of
from ftp_dent_ros.inspection.measuring.outlines.restoration import shown
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.narrow_marks import NarrowMark
from ftp_dent_ros.inspection.measuring.places.placement import axis_along
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.median import median

# Fringes to the wavelength of which half is left, on bare skin.
_FRINGE = 1 / 1.64
# Part of the length that is asked, for a groove runs out; and how far to both sides the skin is,
# in resolutions.
_ALONG, _BESIDE = 0.8, 0.9
# What paint feigns on whole fringes, as a part of the doubt that the cloud states, about: on marks
# without a groove 0.35 at most.
_WHOLE = 0.2
# Fringes that a mark crosses, for a groove to be told from what it feigns.
_CROSSED = 1.0
# Of the depth of what is narrower than the resolution, as a part of it: evenly spread over what is
# calculated of flanks that are hollow (+0.14) to round (-0.21), for straight ones of the same
# width; and how well marks tell widths, in points.
_SHAPE, _POINTS = 0.1, 0.7
# Standard deviations from which on a groove is there: of some 150 marks without one, on all skins,
# one reached 3.0.
_SURE = 3.5
# Cosine of the angle between two axes that are one.
_SAME_WAY = 0.9
# Steeper flanks than 45 degrees, by the depth over the width, are none of a groove.
_STEEP = 0.5
# A groove runs out of its mark at both ends, or the mark out of it, by so much of its length.
_RUNS_OUT = 0.08
_FEWEST = 40
# Of a profile.
_BINS = 41
# Where else a groove is tried, across its mark.
_PLACES = 17
_NAN = Estimate(math.nan, math.nan)

Vector = NDArray[np.float64]
# Distances from a groove's middle, and what a cloud shows there of one that is 1 deep.
Image = tuple[Vector, Vector]


def gouge_under(
    mark: NarrowMark,
    cloud: Cloud,
    deviation: NDArray[np.float32],
    lattice: Lattice,
    skin: BareSkin,
    settings: Settings,
) -> list[MeasuredDent]:
    """The gouge of a mark, if the cloud shows a groove under it.

    What paint alone feigns goes to and fro with the phase of the fringes that it crosses, by as
    much as the cloud's uncertainty says: over n fringes it evens out as 1 / (pi n). Fringes are
    taken to run along the columns: of a mark along them nothing evens out.

    Parameters
    ----------
    mark : NarrowMark
    cloud : Cloud
    deviation : ndarray, shape (rows of the cloud, columns of the cloud), float32
        Depths below the contour, metres.
    lattice : Lattice
    skin : BareSkin
        Of the mark's panel.
    settings : Settings
    """
    contour, sigma, resolution = skin.contour, cloud.sigma, cloud.resolution
    fringes = _fringes(mark, lattice)
    if not fringes >= _CROSSED:
        return []
    x, y, _ = contour.deviation(lattice.all_points[mark.rows, mark.columns].astype(float))
    middle = np.array([x.mean(), y.mean()])
    _, axes = np.linalg.eigh(np.cov(np.stack([x, y])))
    angle = math.atan2(axes[1, 1], axes[0, 1])
    reach = mark.length / 2 + _BESIDE * float(np.nanmedian(resolution)) + mark.width
    window = _window(mark, round(reach * lattice.block / min(lattice.spacing)) + 1)
    near = np.isfinite(deviation[window]) & np.isfinite(sigma[window])
    x, y, _ = contour.deviation(lattice.all_points[window][near].astype(float))
    along = (x - middle[0]) * math.cos(angle) + (y - middle[1]) * math.sin(angle)
    across = (y - middle[1]) * math.cos(angle) - (x - middle[0]) * math.sin(angle)
    depth = deviation[window][near].astype(float)
    inside = (np.abs(along) < mark.length / 2) & (np.abs(across) < mark.width / 2)
    if not inside.any():
        return []
    finest = median(resolution[window][near][inside].astype(float))
    asked = np.abs(along) < _ALONG / 2 * mark.length
    asked &= np.abs(across) < _BESIDE * finest + mark.width
    if not math.isfinite(finest) or asked.sum() < _FEWEST:
        return []
    image = _image(round(mark.width, 5), round(finest, 5))
    highest = float(image[1].max())
    bent = _bent(along[asked], across[asked])
    found, strays = _fitted(image, across[asked], bent, depth[asked])
    doubt = median(sigma[window][near][inside].astype(float))
    evened = math.hypot(1 / (math.pi * fringes), _WHOLE)
    ordinary = math.hypot(strays, skin.noise.where(0.0, 0.0)) / math.sqrt(mark.length / finest)
    chance = math.hypot(doubt * evened, ordinary) / highest
    if not max(_SURE * chance, settings.smallest_depth) <= found < _STEEP * mark.width:
        return []
    if not _is_under(mark.width, image, across[asked], bent, depth[asked]):
        return []
    point = max(lattice.spacing) / lattice.block
    # A groove that is not resolved is as much shallower as it is told wider.
    unsure = math.hypot(_SHAPE * min(finest / mark.width, 1.0), _POINTS * point / mark.width)
    normal = contour.normal(*middle[:, None])[0]
    axis = axis_along(contour, normal, angle)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) / 2
    u, v = (corners * (mark.length, mark.width)).T
    outline = contour.point(
        middle[0] + u * math.cos(angle) - v * math.sin(angle),
        middle[1] + u * math.sin(angle) + v * math.cos(angle),
    )
    ends = math.hypot(_POINTS * point, _RUNS_OUT * mark.length)
    length, width = Estimate(mark.length, ends), Estimate(mark.width, 1.5 * point)
    gouge = MeasuredDent(
        kind='gouge',
        reason=_reason(mark.width, finest),
        position=contour.point(*middle[:, None])[0],
        normal=normal,
        axis=axis,
        depth=Estimate(found, math.hypot(chance, unsure * found)),
        length=length,
        width=width,
        model_length=_NAN,
        model_width=_NAN,
        orientation=Estimate(orientation_of(normal, axis), width.uncertainty / mark.length),
        area=Estimate(mark.length * mark.width, mark.length * width.uncertainty),
        volume=_NAN,
        bottom_radius=math.nan,
        significance=found / chance,
        is_cut=False,
        outline=outline,
        length_profile=_profile(along, depth, np.abs(across) < mark.width / 2, mark.length),
        width_profile=_profile(across, depth, np.abs(along) < mark.length / 4, mark.width),
    )
    return [gouge]


def may_be_feigned(dent: MeasuredDent, marks: Sequence[NarrowMark], lattice: Lattice) -> bool:
    """Whether something narrow lies on a mark along the fringes, where paint may feign a depth.

    Parameters
    ----------
    dent : MeasuredDent
        Relative to the lattice's origin.
    marks : sequence of NarrowMark
    lattice : Lattice
    """
    for mark in marks:
        away = dent.position - mark.middle
        along = float(away @ mark.axis)
        aside = float(np.linalg.norm(away - along * mark.axis))
        if aside > mark.width / 2 or abs(along) > mark.length / 2:
            continue
        if is_along(dent.axis, mark.axis) and _fringes(mark, lattice) < _CROSSED:
            return True
    return False


def is_along(one: Vector, other: Vector) -> bool:
    """Whether two axes are about the same."""
    return abs(float(one @ other)) > _SAME_WAY


def _fringes(mark: NarrowMark, lattice: Lattice) -> float:
    """How many fringes a mark crosses; NaN if the cloud does not tell."""
    if lattice.resolution is None:
        return math.nan
    row, column = (int(each.mean()) // lattice.block for each in (mark.rows, mark.columns))
    last = np.array(lattice.resolution.shape) - 1
    resolution = float(lattice.resolution[min(row, last[0]), min(column, last[1])])
    return mark.crossed * lattice.spacing[0] / lattice.block / (_FRINGE * resolution)


def _reason(width: float, resolution: float) -> str:
    if width > resolution:
        return ''
    return (
        f'its mark is {1e3 * width:.1f} mm wide where the cloud resolves '
        f'{1e3 * resolution:.1f} mm: deep as what is as wide as its mark'
    )


def _window(mark: NarrowMark, reach: int) -> tuple[slice, slice]:
    row, column = round(mark.rows.mean()), round(mark.columns.mean())
    return slice(max(row - reach, 0), row + reach + 1), slice(
        max(column - reach, 0), column + reach + 1
    )


def _fitted(image: Image, across: Vector, beside: Vector, depth: Vector) -> tuple[float, float]:
    """Depth of the groove that fits best, and how far the rest strays, root mean square."""
    columns = np.column_stack([np.interp(np.abs(across), *image), beside])
    solution = np.linalg.lstsq(columns, depth, rcond=None)[0]
    return float(solution[0]), math.sqrt(float(np.square(depth - columns @ solution).mean()))


def _bent(along: Vector, across: Vector) -> Vector:
    """Columns of a skin that is bent as a dent's is around the groove, shape (n, 6)."""
    u, v = along / np.abs(along).max(), across / np.abs(across).max()
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)


def _is_under(width: float, image: Image, across: Vector, beside: Vector, depth: Vector) -> bool:
    """Whether the groove's bottom lies in its mark: one flank of a crease may gleam beside it."""
    places = width * np.linspace(-1, 1, _PLACES)
    left = [_fitted(image, across - place, beside, depth)[1] for place in places]
    return abs(places[int(np.argmin(left))]) < width / 2


@lru_cache(maxsize=256)
def _image(width: float, resolution: float) -> Image:
    """Image of a groove with straight flanks, from its middle outward."""
    step = min(width, resolution) / 40
    count = math.ceil((3 * resolution + width) / step)
    at = step * np.arange(-count, count + 1, dtype=float)
    # Its width is told at a tenth of its depth.
    groove = np.clip(1 - 0.9 * np.abs(at) / (width / 2), 0, None)
    return at[count:], shown(groove, step, resolution)[count:]


def _profile(place: Vector, depth: Vector, on: NDArray[np.bool_], size: float) -> Vector:
    """Mean depths along a line, shape (n, 2), a third of the size beyond both ends."""
    edges = np.linspace(-0.83 * size, 0.83 * size, _BINS + 1)
    count, _ = np.histogram(place[on], edges)
    total, _ = np.histogram(place[on], edges, weights=depth[on])
    with np.errstate(invalid='ignore'):
        return np.stack([(edges[1:] + edges[:-1]) / 2, total / np.where(count, count, 0)], axis=1)
