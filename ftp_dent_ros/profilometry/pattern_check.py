"""Whether the fringes seen can be those of the pattern told.

Vertical fringes give three equations for the three unknowns of each point, so that a wrong period
looks like a tilted surface, and a wrong stripe like another distance. The rim of the projector's
frame does not: light ends there, whatever it falls on. A surface may end before the rim of the
frame that is told, but never beyond it, and where what ends inside is the rim of a frame of
another period, its other sides are where that period has them.
"""

from __future__ import annotations

import math

import numpy as np

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.profilometry.epipolar_check import EpipolarCheck
from ftp_dent_ros.profilometry.lit_area import LitArea

# Fringes that a surface's end is short of the frame's rim, for the windows that it is measured
# in: 0.3 to 0.5 in simulation, and up to so many more or fewer.
_LACK, _LOOSE = 0.4, 0.4
# Fringes beyond the rim from which on no blur and no calibration explains it.
_BEYOND = 0.5
# Projector pixels that the light's upper or lower end must rise over the frame's width to speak;
# and that it lies beyond the rim, or both ends rise, where the geometry is another: far more than
# what a calibration errs by.
_RISE, _ASKEW = 3.0, 8.0
# Of periods: no surface looks as if it were more than so many times the one told.
_LARGEST_RATIO = 2.0
# Degrees by which a surface must face camera and projector the better for a period to be
# believed, and from which on no skin is looked at.
_FACING, _STEEPEST = 3.0, 60.0
# Part of the rows' waves below which they are not there, and by which rows are scaled: a period
# told 4 % off, or half a degree of yaw. Standard uncertainties from which on that is sure.
_FAINT, _STRETCHED, _SURE = 0.3, 0.004, 6.0
_ADVICE = 'give the pattern that is projected (pattern.yaml) and the rig that it is projected with'


def check_pattern(area: LitArea) -> bool:
    """Raise the reason if the fringes cannot be those of the pattern that is told.

    Returns
    -------
    bool
        Whether they can be no other's: the left or right rim of the frame is seen in its place.

    Raises
    ------
    OtherPatternError
        Light ends beyond the frame's rim; or it ends inside where the rims of another period
        lie, all that are in view; or it ends askew to the rims; or the surface would be so steep
        that it could not be seen.
    """
    sides = area.sides()
    if sides and min(sides.values()) < -_BEYOND:
        beyond = -min(sides.values())
        raise OtherPatternError(
            f'the fringes go on {beyond + _LACK:.1f} fringes beyond the rim of the frame that '
            f'{_told(area.pattern)} has; {_seen(area, sides)}: {_ADVICE}'
        )
    period = _inside(area, sides)
    if period is not None:
        raise OtherPatternError(
            f'the fringes end at the rims of a frame with a period of {period:.2f} px (as seen), '
            f'but {_told(area.pattern)} is told: {_ADVICE}'
        )
    if _askew(area):
        raise OtherPatternError(
            f"with {_told(area.pattern)} the light would end beyond the frame's upper or lower "
            f'rim, and askew to it: do not mirror or turn the photograph, and {_ADVICE}'
        )
    tilt = area.tilt(area.pattern.period_px)
    if tilt > _STEEPEST:
        raise OtherPatternError(
            f'with {_told(area.pattern)} the surface would be tilted by {tilt:.0f} degrees; '
            f'fringes of {_facing(area):.1f} px would face camera and projector: {_ADVICE}'
        )
    return any(abs(away - _LACK) < _LOOSE for away in sides.values())


def check_rows(pattern: Pattern, found: EpipolarCheck) -> None:
    """Raise the reason if the rows of the projector cannot be those of the pattern told.

    Raises
    ------
    OtherPatternError
        The contrast does not change along the fringes as told; or it does, but in another
        scale, or far beside the epipolar lines.
    """
    most = found.strength + _SURE * found.strength_deviation
    if most < _FAINT:
        raise OtherPatternError(
            f'along the fringes the contrast does not change every {pattern.row_period_px:g} px '
            f'as the pattern that is told has it (row_depth, row_period_px): {_ADVICE}'
        )
    if not found.seen:
        return
    if abs(found.stretch) > max(_STRETCHED, _SURE * found.stretch_deviation):
        raise OtherPatternError(
            f'the rows of the projector are {1 + found.stretch:.3f} times as far apart as rig and '
            f'pattern have them: {_ADVICE}, and let the projector show images of its own '
            'resolution'
        )
    if abs(found.shift) > max(_ASKEW, _SURE * found.shift_deviation):
        raise OtherPatternError(
            f'the light lies {abs(found.shift):.0f} px beside its epipolar lines: do not mirror '
            f'or turn the photograph, and {_ADVICE}'
        )


def _inside(area: LitArea, sides: dict[bool, float]) -> float | None:
    """Period of the frame at whose rims the light ends, if that is not the one told."""
    pattern = area.pattern
    if not sides or any(abs(away - _LACK) < _LOOSE for away in sides.values()):
        return None
    period, centre = _frame(pattern, sides)
    ratio = period / pattern.period_px
    if not 1 < ratio < _LARGEST_RATIO:
        return None
    told_tilt, tilt = area.tilt(pattern.period_px), area.tilt(period)
    if tilt > told_tilt:
        return None
    if len(sides) == 2:
        agree = abs(centre - pattern.stripe_center_px) < _LOOSE * period
        return period if agree and tilt < told_tilt - _FACING else None
    told, seen = (area.upper_and_lower(each) for each in (pattern.period_px, period))
    for side in told.keys() & seen.keys():
        straightened = seen[side].rise < told[side].rise / 2
        if told[side].on_rim and told[side].rise > _RISE and straightened:
            return period
    return None


def _askew(area: LitArea) -> bool:
    """Whether the light ends on lines across, or beyond, the frame's upper and lower rims."""
    lines = list(area.upper_and_lower(area.pattern.period_px).values())
    lowest = min((line.lowest for line in lines), default=0.0)
    across = [line for line in lines if line.on_rim and line.rise > _ASKEW]
    return lowest < -_ASKEW or (len(across) == 2 and lowest < 0)


def _frame(pattern: Pattern, sides: dict[bool, float]) -> tuple[float, float]:
    """Period and stripe with which the ends are the frame's rims; one end tells the period."""
    first, last = (
        (u - pattern.stripe_center_px) / pattern.period_px for u in (-0.5, pattern.width - 0.5)
    )
    # Fringes from the stripe; an end beyond the stripe is the frame's in no case.
    left = min(first + sides.get(False, 0.0) - _LACK, -1.0)
    right = max(last - sides.get(True, 0.0) + _LACK, 1.0)
    if len(sides) == 2:
        period = pattern.width / (right - left)
        return period, -0.5 - left * period
    ratio = last / right if True in sides else first / left
    return pattern.period_px * ratio, pattern.stripe_center_px


def _told(pattern: Pattern) -> str:
    zero = f'{_zero(pattern)} at {pattern.stripe_center_px:g}'
    return f'a period of {pattern.period_px:g} px with {zero}'


def _zero(pattern: Pattern) -> str:
    """What `stripe_center_px` is the column of."""
    return 'the stripe' if pattern.code == 'stripe' else 'a crest'


def _seen(area: LitArea, sides: dict[bool, float]) -> str:
    """What is seen instead, with its number."""
    pattern = area.pattern
    period, centre = _frame(pattern, sides)
    if len(sides) == 2 and abs(centre - pattern.stripe_center_px) > _LOOSE * period:
        return f'seen is a period of {period:.2f} px with {_zero(pattern)} at {centre:.0f}'
    # Coded fringes are numbered beyond a step too.
    unless = ', if not a step of whole fringes' if pattern.code == 'stripe' else ''
    return f'seen is a period of {period:.2f} px{unless}'


def _facing(area: LitArea) -> float:
    """Period with which the surface would face camera and projector best."""
    periods = area.pattern.period_px * np.exp(np.linspace(math.log(0.4), math.log(2.5), 47))
    return float(min(periods, key=area.tilt))
