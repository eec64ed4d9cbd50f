"""Grooves under narrow light marks: gouges, and scratches, which are shallow ones.

A groove of few millimetres is hardly deeper in the cloud than the cloud is in doubt beside paint,
and narrower than the dents that are looked for. Its mark tells where it would be, how long and how
wide: one depth is left to be asked for, of the points along all of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Estimate, MeasuredDent, SmallestDent, orientation_of
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.grooves import Strip, Vector
from ftp_dent_ros.inspection.measuring.places.narrow_marks import NarrowMark
from ftp_dent_ros.inspection.measuring.places.placement import axis_along
from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice

# Fringes to the wavelength of which half is left, on bare skin.
_FRINGE = 1 / 1.64
# What paint feigns on whole fringes, as a part of the doubt that the cloud states, about: on marks
# without a groove 0.35 at most.
_WHOLE = 0.2
# Fringes that a mark crosses, for a groove to be told from what it feigns; and those over which
# that evens out by nothing.
_CROSSED, _NONE = 1.0, 1 / math.pi
# Of a mark along the fringes, in points: they leave light lines of one or two.
_BROAD = 2.5
# Of the depth of what is narrower than the resolution, as a part of it: evenly spread over what is
# calculated of flanks that are hollow (+0.14) to round (-0.21), for straight ones of the same
# width; and how well marks tell widths, in points.
_SHAPE, _POINTS = 0.1, 0.7
# Standard deviations from which on a groove is there: of some 150 marks without one, on all skins,
# one reached 3.0. And from which on there may be one, for no mark on even skin is to go without a
# word.
_SURE, _MAYBE = 3.5, 1.0
# Marks of a cloud from which on both are more, for what is seen at many places is seen at one of
# them by chance: skin without dirt has no more, but for some of rivets and letters.
_FEW = 10
# Cosine of the angle between two axes that are one.
_SAME_WAY = 0.9
# Steeper flanks than 45 degrees, by the depth over the width, are none of a groove.
_STEEP = 0.5
# A groove runs out of its mark at both ends, or the mark out of it, by so much of its length.
_RUNS_OUT = 0.08
_NAN = Estimate(math.nan, math.nan)
_IN_DOUBT = 'a narrow light mark, under which there may be a groove'
#: What is said of a groove that such a mark may feign.
FEIGNED = 'on a light mark along the fringes, where paint may feign a depth'


def gouge_under(
    mark: NarrowMark,
    marks: int,
    cloud: Cloud,
    deviation: NDArray[np.float32],
    lattice: Lattice,
    skin: BareSkin,
    settings: SmallestDent,
) -> list[MeasuredDent]:
    """The gouge of a mark, if the cloud shows a groove under it; `other` if there may be one.

    What paint alone feigns goes to and fro with the phase of the fringes that it crosses, by as
    much as the cloud's uncertainty says: over n fringes it evens out as 1 / (pi n). Fringes are
    taken to run along the columns: of a mark along them nothing evens out, and it is in doubt.

    Parameters
    ----------
    mark : NarrowMark
    marks : int
        How many there are in the cloud.
    cloud : Cloud
    deviation : ndarray, shape (rows of the cloud, columns of the cloud), float32
        Depths below the contour, metres.
    lattice : Lattice
    skin : BareSkin
        Of the mark's panel.
    settings : SmallestDent
    """
    fringes = _fringes(mark, lattice)
    point = max(lattice.spacing) / lattice.block
    is_crossed = fringes >= _CROSSED
    if math.isnan(fringes) or not (is_crossed or mark.width > _BROAD * point):
        return []
    strip = Strip.under(mark, cloud, deviation, lattice, skin.contour)
    if strip is None:
        return []
    groove = strip.groove
    found, strays = groove.deepest_and_strays
    evened = math.hypot(_NONE / max(fringes, _NONE), _WHOLE)
    ordinary = math.hypot(strays, skin.noise.where(0.0, 0.0)) / math.sqrt(
        mark.length / strip.resolution
    )
    chance = math.hypot(strip.doubt * evened, ordinary) / groove.shown
    # Errors follow Laplace's distribution (`evidence.threshold`).
    more = math.log(max(marks / _FEW, 1.0)) / math.sqrt(2)
    sure = (_SURE + more) * chance
    maybe = (_MAYBE + more) * chance if mark.is_on_even_skin else sure
    least = max(maybe, settings.smallest_depth)
    if not least <= found < _STEEP * mark.width:
        return []
    is_sure = is_crossed and found >= sure and groove.is_in_mark()
    if is_sure:
        reason = _reason(mark.width, strip.resolution)
    else:
        reason = _IN_DOUBT if is_crossed else FEIGNED
    kind = 'gouge' if is_sure else 'other'
    return [_described(kind, reason, strip, skin.contour, Estimate(found, chance), point)]


def _described(
    kind: str, reason: str, strip: Strip, contour: Contour, depth: Estimate, point: float
) -> MeasuredDent:
    """A groove of a depth, which chance makes unsure, and of the size of its mark.

    A `point` of the cloud is so many metres.
    """
    length, width = strip.length, strip.width
    # A groove that is not resolved is as much shallower as it is told wider.
    unsure = math.hypot(_SHAPE * min(strip.resolution / width, 1.0), _POINTS * point / width)
    normal = contour.normal(*strip.middle[:, None])[0]
    axis = axis_along(contour, normal, strip.angle)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) / 2
    u, v = (corners * (length, width)).T
    outline = contour.point(
        strip.middle[0] + u * math.cos(strip.angle) - v * math.sin(strip.angle),
        strip.middle[1] + u * math.sin(strip.angle) + v * math.cos(strip.angle),
    )
    ends = math.hypot(_POINTS * point, _RUNS_OUT * length)
    off = 1.5 * point
    along, across = strip.profiles()
    return MeasuredDent(
        kind=kind,
        reason=reason,
        position=contour.point(*strip.middle[:, None])[0],
        normal=normal,
        axis=axis,
        depth=Estimate(depth.value, math.hypot(depth.uncertainty, unsure * depth.value)),
        length=Estimate(length, ends),
        width=Estimate(width, off),
        model_length=_NAN,
        model_width=_NAN,
        orientation=Estimate(orientation_of(normal, axis), off / length),
        area=Estimate(length * width, length * off),
        volume=_NAN,
        bottom_radius=math.nan,
        significance=depth.value / depth.uncertainty,
        is_cut=False,
        outline=outline,
        length_profile=along,
        width_profile=across,
    )


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
