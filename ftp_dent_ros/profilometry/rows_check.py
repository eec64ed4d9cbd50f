"""Whether the projector's rows can be those of the given pattern."""

from __future__ import annotations

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.epipolar_check import EpipolarCheck
from ftp_dent_ros.profilometry.pattern_check import ADVICE, ASKEW, told
from ftp_dent_ros.profilometry.rig_alarm import TOLERANCE

# Part of the rows' waves below which they are not there, and by which rows are scaled: a period
# given 4 % off, or half a degree of yaw. Standard uncertainties from which on that is sure.
_FAINT, _STRETCHED, _SURE = 0.3, 0.004, 6.0
# Sum of squares over variances from which on rows are off; and the share of it that the true
# pattern leaves.
_OFF, _LEFT = 25.0, 0.25


def check_rows(
    pattern: Pattern,
    found: EpipolarCheck,
    other: Pattern | None = None,
    under_other: EpipolarCheck | None = None,
) -> None:
    """Raise the reason if the rows of the projector cannot be those of the given pattern.

    Parameters
    ----------
    pattern : Pattern
    found : EpipolarCheck
    other : Pattern, optional
        That of `other_frame`, and what the rows say under it.
    under_other : EpipolarCheck, optional

    Raises
    ------
    OtherPatternError
        The contrast does not change along the fringes as given; or it does, but in another
        scale, or far beside the epipolar lines; or off them as under the other pattern it is not.
    """
    most = found.strength + _SURE * found.strength_deviation
    if most < _FAINT:
        raise OtherPatternError(
            f'along the fringes the contrast does not change every {pattern.row_period_px:g} px '
            f'as the given pattern has it (row_depth, row_period_px): {ADVICE}'
        )
    if not found.seen:
        return
    if other is not None and under_other is not None and under_other.seen:
        off, left = (_off(each, found) for each in (found, under_other))
        if off > _OFF and left < _LEFT * off:
            raise OtherPatternError(
                f'the fringes end, and their rows lie, as in a frame with a period of '
                f'{other.period_px:.2f} px and a crest at {other.stripe_center_px:.0f} (as seen), '
                f'but {told(pattern)} is given: {ADVICE}'
            )
    if abs(found.stretch) > max(_STRETCHED, _SURE * found.stretch_deviation):
        raise OtherPatternError(
            f'the rows of the projector are {1 + found.stretch:.3f} times as far apart as rig and '
            f'pattern have them: {ADVICE}, and let the projector show images of its own '
            'resolution'
        )
    if abs(found.shift) > max(ASKEW, _SURE * found.shift_deviation):
        raise OtherPatternError(
            f'the light lies {abs(found.shift):.0f} px beside its epipolar lines: do not mirror '
            f'or turn the photograph, and {ADVICE}'
        )


def _off(check: EpipolarCheck, certain: EpipolarCheck) -> float:
    """How far shift, turn and stretch are off: the sum of their squares over variances.

    The variances are those of `certain`: what is less certain lies no better.
    """
    return sum(
        (scale * value) ** 2 / ((of * deviation) ** 2 + TOLERANCE**2)
        for value, deviation, scale, of in (
            (check.shift, certain.shift_deviation, 1.0, 1.0),
            (check.turn, certain.turn_deviation, check.reach, certain.reach),
            (check.stretch, certain.stretch_deviation, check.height, certain.height),
        )
    )
