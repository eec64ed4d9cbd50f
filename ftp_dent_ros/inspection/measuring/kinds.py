"""What a place that departs from the skin is: the rules.

With sizes on the contour at 10 % of the depth:

- nothing: shallower than the smallest dent; or surely narrower, and outward: a rivet.
- *other*: the cloud is not sure of the surface there; or it is steeper than skin can be dented,
  as where a wing's root meets the fuselage; or its bottom is not measured; or the rim of the
  measured area cuts it, and what is seen of it is shallow or narrower than the smallest dent; or
  it is narrower than that, or may be shorter.
- *bump*: outward.
- *crease*: longer than `LONG` widths, at half of its depth too, and its radius of curvature at
  the bottom is smaller than `_SHARP` width^2 / (8 depth) (a Gaussian has 0.47 of it, a paraboloid
  1.1), or it is so narrow that the reconstruction cannot show whether it is. With a bottom that
  looks blunt it must be surely narrower than the smallest dent, too. Repair manuals treat a
  crease as a crack.
- *dent*: all else that is inward.
"""

from __future__ import annotations

from ftp_dent_ros.dents.dent import COVERAGE, SmallestDent
from ftp_dent_ros.inspection.measuring.outline import CUT
from ftp_dent_ros.inspection.measuring.sizes import CAP, Sizes

#: Longer than so many widths is long: a valley, not a round dent.
LONG = 1.8
#: What is deeper than this part of its width is no dented skin: metal folds at a twelfth, and the
# steepest crease of the simulation, at a quarter of its axis, has 0.26.
STEEP = 0.3
_SHARP = 0.33
# A valley narrower than so many wavelengths of which half is left may be sharp.
_UNRESOLVED = 3.0
#: Depths, in smallest ones, of what the rim cuts, for the contour is known on one side of it only.
AT_RIM = 4.0


def kind_of(
    sizes: Sizes, sign: int, resolution: float, settings: SmallestDent, shared: str
) -> tuple[str, str]:
    """Kind, and the reason where it is in doubt; an empty kind is too small to list.

    Parameters
    ----------
    sizes : Sizes
    sign : int
        1 inward, -1 outward.
    resolution : float
        Wavelength of which half is left, metres; NaN if it is not known.
    settings : SmallestDent
    shared : str
        What is said of a dent that shares its place with others, or may do so.
    """
    depth, width, least = sizes.depth.value, sizes.width.value, settings.smallest_width
    surely = width + COVERAGE * sizes.width.uncertainty < least
    if (surely and sign < 0) or depth < settings.smallest_depth:
        return '', ''
    if depth > STEEP * max(width, least):
        return 'other', 'too steep for a dent or a bump: the skin turns here, or ends'
    is_sure = depth > COVERAGE * sizes.depth.uncertainty
    # What shows its bottom may be hidden by half.
    is_shown = is_sure and sizes.shown >= CAP * depth
    if sizes.hidden > (1 / 2 if is_shown else CUT):
        return 'other', f'not measured at its bottom: at least {1e3 * sizes.shown:.2f} mm deep'
    if sizes.is_cut and min(depth / AT_RIM / settings.smallest_depth, width / least) < 1:
        return 'other', 'is cut by the rim of what is measured, where the skin is not known'
    bluntness = 8 * depth * sizes.radius / width**2
    valley = sign > 0 and min(sizes.length.value / width, sizes.slender) > LONG
    may_be_sharp = bluntness >= _SHARP and (surely or bluntness < 1)
    if valley and may_be_sharp and width < _UNRESOLVED * resolution:
        return 'crease', 'too narrow to see how sharp it is'
    if not is_sure:
        unsure = 1e3 * sizes.depth.uncertainty
        return 'other', f'the cloud is not sure of the surface here ({unsure:.2f} mm)'
    if valley and bluntness < _SHARP:
        return 'crease', ''
    if surely:
        return 'other', 'narrower than the smallest dent'
    # Its length as it is drawn: what noise may have added is no reason to leave it out.
    if sizes.outline.length[0] < least:
        return 'other', 'may be smaller than the smallest dent'
    if sign < 0:
        return 'bump', ''
    if sizes.hidden > CUT:
        return 'dent', f'cut by what was not measured ({100 * sizes.hidden:.0f} % of it)'
    if width < least:
        return 'dent', 'may be narrower than the smallest dent'
    return 'dent', shared
