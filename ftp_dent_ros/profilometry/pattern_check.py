"""Whether the fringes seen can be those of the given pattern.

Vertical fringes give three equations for the three unknowns of each point, so that a wrong period
looks like a tilted surface, and a wrong stripe like another distance. The rim of the projector's
frame does not: light ends there, whatever it falls on. A surface may end before the rim of the
given frame, but never beyond it, and where what ends inside is the rim of a frame of
another period, its other sides are where that period has them.

The code of coded fringes begins with the frame's first one, whatever the period, so that the
first rim tells nothing; the last one tells how many fringes there are.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.lit_area import LitArea

# Fringes that the light's end is seen off the frame's rim, at most: blur and windows.
_LOOSE = 0.4
# Fringes beyond the rim from which on no blur and no calibration explains it.
_BEYOND = 0.9
# Projector pixels that the light's upper or lower end must rise over the frame's width to speak;
# and that it lies beyond the rim, or both ends rise, where the geometry is another: far more than
# what a calibration errs by.
_RISE, ASKEW = 3.0, 8.0
# Of how far inside the rim the light's end is seen: blur hides that much, and not the same at
# both ends.
_UNEVEN = 0.5
# Of periods: no surface looks as if it were more than so many times the given one.
_LARGEST_RATIO = 2.0
# Degrees by which a surface must face camera and projector the better for a period to be
# believed, and from which on no skin is looked at.
_FACING, _STEEPEST = 3.0, 60.0
# Fringes by which the last rim is elsewhere if the zero of the code is; beyond, it is the period.
_OFF_ZERO = 0.75
#: What to do about another pattern.
ADVICE = 'give the pattern that is projected (pattern.yaml) and the rig that it is projected with'


def check_pattern(area: LitArea) -> bool:
    """Raise the reason if the fringes cannot be those of the given pattern.

    Returns
    -------
    bool
        Whether they can be no other's: the left or right rim of the frame is seen in its place,
        of coded fringes that behind the last one.

    Raises
    ------
    OtherPatternError
        Light ends beyond the frame's rim; or it ends inside where the rims of another period
        lie, all that are in view; or it ends askew to the rims; or the surface would be so steep
        that it could not be seen.
    """
    sides = area.sides
    if sides and min(sides.values()) < -_BEYOND:
        beyond = -min(sides.values())
        raise OtherPatternError(
            f'the fringes go on {beyond:.1f} fringes beyond the rim of the frame that '
            f'{described(area.pattern)} has; {_seen(area, sides)}: {ADVICE}'
        )
    period = _inside(area, sides)
    if period is not None:
        raise OtherPatternError(
            f'the fringes end at the rims of a frame with a period of {period:.2f} px (as seen), '
            f'but {described(area.pattern)} is given: {ADVICE}'
        )
    if _askew(area):
        raise OtherPatternError(
            f"with {described(area.pattern)} the light would end beyond the frame's upper or "
            f'lower rim, and askew to it: do not mirror or turn the photograph, and {ADVICE}'
        )
    if area.tilt(area.pattern.period_px) > _STEEPEST:
        raise too_steep(area)
    return _in_place(area.pattern, sides)


def too_steep(area: LitArea) -> OtherPatternError:
    """What is said of a surface that would be too steep for its fringes to be seen so."""
    tilt = area.tilt(area.pattern.period_px)
    return OtherPatternError(
        f'with {described(area.pattern)} the surface would be tilted by {tilt:.0f} degrees; '
        f'fringes of {_facing(area):.1f} px would face camera and projector: {ADVICE}'
    )


def other_frame(area: LitArea) -> Pattern | None:
    """The coded pattern at whose last rim the light ends, if that is not the given one.

    A skin may end there as well: the rows tell (`check_rows`).
    """
    pattern, sides = area.pattern, area.sides
    if not pattern.tells_rows or True not in sides or _in_place(pattern, sides):
        return None
    period, centre = _frame(pattern, sides)
    if not pattern.period_px / _LARGEST_RATIO < period < _LARGEST_RATIO * pattern.period_px:
        return None
    return replace(pattern, period_px=period, stripe_center_px=centre)


def other_code(pattern: Pattern) -> OtherPatternError:
    """What is said where the fringes show another code than the pattern's."""
    return OtherPatternError(
        f'the code of the fringes is of another pattern than one of {described(pattern)}: '
        f'do not mirror or turn the photograph, and {ADVICE}'
    )


def _in_place(pattern: Pattern, sides: dict[bool, float]) -> bool:
    """Whether a rim of the frame that tells the period is where it must be."""
    telling = [away for last, away in sides.items() if last or pattern.code == 'stripe']
    # A part of a fringe that the zero is off is not the period's.
    loose = _LOOSE if pattern.code == 'stripe' else _LOOSE / 2
    return any(abs(away) < loose for away in telling)


def _inside(area: LitArea, sides: dict[bool, float]) -> float | None:
    """Period of the frame at whose rims the light ends, if that is not the given one."""
    pattern = area.pattern
    if not sides or any(abs(away) < _LOOSE for away in sides.values()):
        return None
    if pattern.tells_rows:
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
    lines, seen = (area.upper_and_lower(each) for each in (pattern.period_px, period))
    for side in lines.keys() & seen.keys():
        straightened = seen[side].rise < lines[side].rise / 2
        least = max(_RISE, _UNEVEN * lines[side].level)
        if lines[side].on_rim and lines[side].rise > least and straightened:
            return period
    return None


def _askew(area: LitArea) -> bool:
    """Whether the light ends on lines across, or beyond, the frame's upper and lower rims."""
    lines = list(area.upper_and_lower(area.pattern.period_px).values())
    lowest = min((line.lowest for line in lines), default=0.0)
    across = [line for line in lines if line.on_rim and line.rise > ASKEW]
    return lowest < -ASKEW or (len(across) == 2 and lowest < 0)


def _frame(pattern: Pattern, sides: dict[bool, float]) -> tuple[float, float]:
    """Period and stripe with which the ends are the frame's rims; one end tells the period."""
    first, last = (
        (u - pattern.stripe_center_px) / pattern.period_px for u in (-0.5, pattern.width - 0.5)
    )
    if pattern.code == 'contrast' and len(sides) == 1:
        return _frame_of_code(pattern, sides, first, last)
    # Fringes from the stripe; an end beyond the stripe is the frame's in no case.
    left = min(first + sides.get(False, 0.0), -1.0)
    right = max(last - sides.get(True, 0.0), 1.0)
    if len(sides) == 2:
        period = pattern.width / (right - left)
        return period, -0.5 - left * period
    ratio = last / right if True in sides else first / left
    return pattern.period_px * ratio, pattern.stripe_center_px


def _frame_of_code(
    pattern: Pattern, sides: dict[bool, float], first: float, last: float
) -> tuple[float, float]:
    """Period and zero with which one end is the frame's rim, if the first is in its place."""
    if True not in sides:
        return pattern.period_px, -0.5 - (first + sides[False]) * pattern.period_px
    right = last - sides[True]
    if abs(right - last) < _OFF_ZERO:
        return pattern.period_px, pattern.width - 0.5 - right * pattern.period_px
    period = pattern.width / (right - first)
    return period, -0.5 - first * period


def described(pattern: Pattern) -> str:
    """Period and zero of a pattern, in words."""
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
