"""A candidate to the dents that it holds, on the full cloud."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import COVERAGE, Estimate, MeasuredDent, SmallestDent, orientation_of
from ftp_dent_ros.inspection.measuring.hidden import not_at_bottom
from ftp_dent_ros.inspection.measuring.model_axes import model_axes
from ftp_dent_ros.inspection.measuring.outlines.bridging import Bridged, bridged
from ftp_dent_ros.inspection.measuring.outlines.division import divided
from ftp_dent_ros.inspection.measuring.outlines.maxima import DROP, maxima_of
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.outlines.peak import extent, radius_across
from ftp_dent_ros.inspection.measuring.outlines.restoration import restored
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.detection import Candidate
from ftp_dent_ros.inspection.measuring.places.evidence import SIGNIFICANT
from ftp_dent_ros.inspection.measuring.places.kinds import Appearance, kind_of
from ftp_dent_ros.inspection.measuring.places.marks import mark_in
from ftp_dent_ros.inspection.measuring.places.placement import axis_along, on_skin, profiles_of
from ftp_dent_ros.inspection.measuring.places.sampling import own_cells, patch_of
from ftp_dent_ros.inspection.measuring.places.surroundings import Surroundings
from ftp_dent_ros.inspection.measuring.sizes import LEVEL, Sizes, of_sharp_bottom, sizes_of
from ftp_dent_ros.inspection.measuring.skin.gaps import GAP

# A candidate that is so many times longer than wide is a ridge, unless its saddles are so deep.
_RIDGE, _RIDGE_DROP = 3.5, 0.5
#: Standard uncertainties that a depth has at least for its kind to be listed: fittings that are
# not resolved come out round. Of what is long the smoothing hides the depth but not the kind,
# where it adds more than a fiftieth to what is uncertain.
CERTAIN, _CERTAIN_LONG, _HIDES = 4.5, 2.7, 0.2
_MM = 1e3
# Part of a dent that has no points, from which on it is cut.
_HIDDEN = 0.05
# Maxima are looked for from this part of the smallest depth on.
_NEARLY = 0.8
_HALF = 0.5
#: Points of a cloud that does not state its resolution show waves of so many spacings by half.
SUPPOSED = 4.0

Mask = NDArray[np.bool_]


def measure(
    candidate: Candidate,
    around: Surroundings,
    skin: BareSkin,
    settings: SmallestDent,
) -> list[MeasuredDent]:
    """Measure every dent of a candidate that is not too small.

    Parameters
    ----------
    candidate : Candidate
    around : Surroundings
    skin : BareSkin
    settings : SmallestDent
    """
    raw = patch_of(candidate, around, skin.noise)
    local = skin.noise.where(around.extra, raw.scale)
    own = own_cells(raw, around)
    whole = restored(raw, around.resolution, SUPPOSED * around.spacing)
    seen = bridged(whole, GAP * settings.smallest_width, own)
    # Along a ridge the depth varies as the fringes do.
    drop = _RIDGE_DROP if candidate.length > _RIDGE * candidate.width else DROP
    least = _NEARLY * settings.smallest_depth
    # Saddles between what was not measured are no surer than that.
    unsure = float(seen.doubt[seen.bridged].mean()) if seen.bridged.any() else 0.0
    peaks = maxima_of(seen.patch, math.hypot(local, unsure), least, drop) or _deepest(
        seen.patch, own, least
    )
    peaks = [at for at in peaks if own[at]]
    dents = []
    for peak, region in zip(peaks, divided(seen.patch, peaks, LEVEL), strict=True):
        found = _one(candidate, seen, raw, peak, region, around, skin, settings)
        if found is not None:
            dents.append(found)
    return dents


def _deepest(patch: Patch, own: Mask, least: float) -> list[tuple[int, int]]:
    """The deepest cell: where none stands out by itself, all of a candidate's together may."""
    depth = np.where(own & patch.known, patch.depth, 0.0)
    row, column = np.unravel_index(np.argmax(depth), depth.shape)
    return [(int(row), int(column))] if depth[row, column] > least else []


def _one(
    candidate: Candidate,
    seen: Bridged,
    plain: Patch,
    at: tuple[int, int],
    region: Mask | None,
    around: Surroundings,
    skin: BareSkin,
    settings: SmallestDent,
) -> MeasuredDent | None:
    patch, sign = seen.patch, candidate.sign
    sizes = sizes_of(seen, plain, at, region, around, skin)
    if sizes is None:
        return None
    if sizes.significance < SIGNIFICANT:
        return None
    length, width, outline = sizes.length.value, sizes.width.value, sizes.outline
    if skin.relief and sizes.depth.value < SIGNIFICANT * skin.relief.uncertainty(width):
        # It may well be one of the waves, which are listed by themselves.
        return None
    across = sizes.angle + math.pi / 2
    whole = seen.is_measured_across(at, across, width)
    radius = radius_across(patch, at, sizes.depth.value, across, width) if whole else math.nan
    half_length, half_width, _ = extent(patch, at, _HALF, region)
    kind, reason = kind_of(
        Appearance(
            sign * sizes.depth.value,
            length,
            width,
            radius,
            around.resolution,
            *mark_in(around, patch, outline),
            outline.is_cut,
            sizes.width.uncertainty,
            half_length / half_width,
            outline.area / skin.area,
        ),
        settings,
    )
    if not kind:
        return None
    if kind in ('crease', 'gouge'):
        sizes = of_sharp_bottom(sizes, around.resolution, not reason)
    if _is_unsure(sizes, kind):
        unsure = _MM * math.hypot(sizes.chance, sizes.depth.uncertainty)
        kind, reason = 'other', f'the cloud is not sure of the surface here ({unsure:.2f} mm)'
        if seen.bridged[at]:
            beside = (outline.inside > 0.5) & ~seen.bridged
            reason = not_at_bottom(float(patch.depth[beside].max(initial=0)), sizes.chance)
    if sizes.hidden > _HIDDEN:
        reason = reason or f'cut by what was not measured ({100 * sizes.hidden:.0f} % of it)'
    if not reason and kind == 'dent' and region is not None:
        reason = 'overlaps another one: its outline ends where they part'
    contour, (x, y) = skin.contour, outline.centre
    position, normal, line = on_skin(contour, outline, sign * LEVEL * sizes.depth.value)
    axis = axis_along(contour, normal, outline.axis())
    both = np.array([length, width])
    lengthwise, crosswise = profiles_of(seen.measured, sign, x, y, sizes.angle, both)
    model_length, model_width = model_axes(sizes, patch, region, skin.noise.correlated_area)
    return MeasuredDent(
        kind=kind,
        reason=reason,
        position=position,
        normal=normal,
        axis=axis,
        depth=_signed(sign, sizes.depth),
        length=sizes.length,
        width=sizes.width,
        model_length=model_length,
        model_width=model_width,
        orientation=Estimate(orientation_of(normal, axis), sizes.turn.uncertainty),
        area=sizes.area,
        volume=_signed(sign, sizes.volume),
        bottom_radius=radius,
        significance=sizes.significance,
        is_cut=outline.is_cut or sizes.hidden > _HIDDEN,
        outline=line,
        length_profile=lengthwise,
        width_profile=crosswise,
    )


def _is_unsure(sizes: Sizes, kind: str) -> bool:
    """Whether what is seen is not evident enough for its kind, or its sizes are not measured."""
    measured = (sizes.depth, sizes.length, sizes.width, sizes.area, sizes.volume)
    doubt = max(CERTAIN * sizes.depth.uncertainty, SIGNIFICANT * sizes.unresolved)
    is_hidden = sizes.unresolved > _HIDES * sizes.depth.uncertainty
    if kind in ('crease', 'gouge') and is_hidden:
        left = max(sizes.depth.uncertainty**2 - sizes.unresolved**2, 0)
        doubt = _CERTAIN_LONG * math.sqrt(left)
    is_vague = kind == 'crease' and sizes.width.value < COVERAGE * sizes.width.uncertainty
    return (
        sizes.significance < SIGNIFICANT
        or sizes.depth.value < doubt
        or (is_vague and not is_hidden)
        or not all(each.is_measured for each in measured)
    )


def _signed(sign: int, estimate: Estimate) -> Estimate:
    return Estimate(sign * estimate.value, estimate.uncertainty)
