"""What a place that departs from the skin is: the rules.

In this order, with sizes on the contour at 10 % of the depth:

- *other*: steeper than skin can be dented, as where a wing's root meets the fuselage.
- *bump*: outward.
- *gouge*: narrower than `_NARROW`, as far as the reconstruction can show how narrow it is, longer
  than `LONG` widths, and the light in it is brighter than that beside it by more than `_MARK`, or
  darker by more than slopes can make it, and by more than that varies: material or paint is gone.
  A scratch is a shallow gouge.
- *crease*: longer than `LONG` widths, at half of its depth too, and its radius of curvature at
  the bottom is smaller than `_SHARP` width^2 / (8 depth) (a Gaussian has 0.48 of it, a paraboloid
  1.1), or it is so narrow that the reconstruction cannot show whether it is; but not where it is
  not measured all across its bottom, for what an edge cuts is long and sharp. Of what is narrower
  than `_BLURRED` resolutions neither is asked, the length at half of its depth from `_DRAWN_OUT`
  widths on. Repair manuals treat a crease as a crack. How wide it is need not be known where the
  smoothing hides that: what is narrower still is one as well.
- *dent*: all else that is inward, whole, and as wide as the smallest dent.
- *other*: significant and deep enough, but it is long and narrower than the smallest dent, or may
  be, the rim of the measured area cuts it, or it lies along that rim, or it is so large a part of
  its panel besides that it may be another one; with the reason.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ftp_dent_ros.dents.dent import SmallestDent

# Metres.
_NARROW = 0.006
# How much of its resolution (the wavelength of which half is left) a reconstruction adds to the
# width of what is narrow, in quadrature: measured on grooves 4 to 6 mm wide. Where that is more
# than so many times `_NARROW`, it cannot show what is narrow.
_WIDENED, _SHOWN = 1.1, 1.2
#: Longer than so many widths is long: a valley, not a round dent.
LONG = 1.8
#: What is deeper than this part of its width is no dented skin: metal folds at a twelfth, and the
# steepest crease of the simulation, at a quarter of its axis, has 0.26.
STEEP = 0.3
# Slopes make no skin brighter: 6 % is more than fringes leave of the light. They shade it by the
# cosine of their angle (Lambert's law; of two that face each other, wherever the lamp is).
_MARK, _SHADED = 0.06, 1 - 1 / math.hypot(1, 2 * STEEP)
_SHARP = 0.33
# A crease narrower than so many wavelengths of which half is left looks like a valley; what is
# shown of one narrower than `_BLURRED` of them is as blunt as of any.
_UNRESOLVED, _LONGER, _BLUNT, _BLURRED = 3.0, 2.5, 1.0, 1.4
# Below half of its depth a narrow valley falls apart, for its depth ripples as the fringes do:
# what is so many times as long as wide is long without that.
_DRAWN_OUT = 4.0
#: Depths, in smallest ones, of what the rim cuts, for the contour is known on one side of it only;
# what lies along it, longer than so many widths, is rarely skin.
AT_RIM = 4.0
_STRIP, _STRIP_CUT = 2.8, 8.0
# Part of its panel from which on what the rim cuts may be another panel: of a skin that is hidden
# by more, the contour is a guess. Looked at on one strip beyond a lap, which took 0.2.
_PANEL = 0.15
_ANOTHER = 'other', 'is cut by the rim and may be another panel'


@dataclass(frozen=True)
class Appearance:
    """What the rules ask.

    Attributes
    ----------
    depth : float
        Metres, outward negative.
    length, width : float
        On the contour at 10 % of the depth, metres.
    radius : float
        Of curvature at the bottom across the length, metres; NaN if it is not measured there.
    resolution : float
        Wavelength of which half is left, metres; NaN if it is not known.
    mark : float
        Change of the light within, as a part of that beside it.
    mottled : float
        How far the light beside it varies (1.4826 times the median absolute deviation), alike.
    is_cut : bool
    width_doubt : float
        Standard uncertainty of the width, metres.
    slender : float
        Length over width at half of the depth, which noise does not draw out.
    share : float
        Part of its panel's area that it takes.
    """

    depth: float
    length: float
    width: float
    radius: float
    resolution: float
    mark: float
    mottled: float
    is_cut: bool
    width_doubt: float
    slender: float
    share: float = 0.0


def kind_of(seen: Appearance, settings: SmallestDent) -> tuple[str, str]:
    """Kind, and the reason where it is in doubt; an empty kind is too small to list."""
    deep = abs(seen.depth)
    blurred = seen.width < _BLURRED * seen.resolution
    drawn_out = blurred and seen.length > _DRAWN_OUT * seen.width
    long = drawn_out or min(seen.length / seen.width, seen.slender) > LONG
    if deep < settings.smallest_depth or seen.length < settings.smallest_width:
        return '', ''
    narrow = seen.width < settings.smallest_width
    vast = seen.is_cut and seen.share >= _PANEL
    if deep > STEEP * seen.width and not narrow:
        return 'other', 'too steep for a dent or a bump: the skin turns here, or ends'
    if seen.is_cut:
        strip = seen.length > _STRIP * seen.width
        if deep < (_STRIP_CUT if strip else AT_RIM) * settings.smallest_depth or narrow:
            place = 'lies along' if strip else 'is cut by'
            return 'other', f'{place} the rim of what is measured, where the skin is not known'
    if seen.depth < 0:
        if narrow:
            return ('other', 'a narrow ridge') if long else ('', '')
        return _ANOTHER if vast else ('bump', '')
    widened = _WIDENED * seen.resolution if math.isfinite(seen.resolution) else 0.0
    thin = seen.width < math.hypot(_NARROW, widened) and widened < _SHOWN * _NARROW
    is_marked = seen.mark > max(_MARK, seen.mottled) or -seen.mark > max(_SHADED, seen.mottled)
    if long and thin and is_marked:
        return 'gouge', ''
    if long:
        bluntness = 8 * deep * seen.radius / seen.width**2
        unresolved = seen.width < _UNRESOLVED * seen.resolution
        is_sharp = bluntness < _BLUNT or (blurred and math.isfinite(bluntness))
        unresolved = unresolved and is_sharp and seen.length > _LONGER * seen.width
        if bluntness < _SHARP or unresolved:
            return 'crease', '' if bluntness < _SHARP else 'too narrow to see how sharp it is'
    if narrow:
        doubtful = seen.width + seen.width_doubt > settings.smallest_width
        return ('other', 'narrower than the smallest dent') if long or doubtful else ('', '')
    return _ANOTHER if vast else ('dent', '')
