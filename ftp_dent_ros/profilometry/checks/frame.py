"""Whether the light lies in the projector's frame, and ends where the frame does.

Vertical fringes give three equations for the three unknowns of each point, so that a wrong period
looks like a tilted surface, and a wrong stripe like another distance. The frame tells: a surface
may end before its left or right rim, but light is nowhere beyond them. Where rows end at a rim
itself, within a fringe, the pattern is the given one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.pattern.pattern import Pattern

# Share of the light that glints and reflections show more than a fringe beyond the frame.
_BEYOND = 0.005
# Share of the rows that end at a rim: it is their end, and no spot's.
_ROWS = 0.25
#: What to do about another pattern.
ADVICE = (
    'do not mirror or turn the photograph, and give the pattern that is projected (pattern.yaml) '
    'and the rig that it is projected with'
)


def check_frame(pattern: Pattern, phase: NDArray[np.floating], lit: NDArray[np.bool_]) -> bool:
    """Raise the reason if the light cannot be that of the given frame.

    Parameters
    ----------
    pattern : Pattern
    phase : ndarray, shape (rows, columns)
        Absolute, radians; of `lit` only.
    lit : ndarray, shape (rows, columns), bool
        Where there are numbered fringes.

    Returns
    -------
    bool
        Whether it can be no other's: many rows end within a fringe of the left or right rim, of
        coded fringes the right one, as the code begins with the first.

    Raises
    ------
    OtherPatternError
    """
    rims = pattern.phase([-0.5, pattern.width - 0.5])
    outwards = np.maximum(rims[0] - phase[lit], phase[lit] - rims[1])
    beyond = np.mean(outwards > 2 * np.pi) if lit.any() else 0.0
    if beyond > _BEYOND:
        raise OtherPatternError(
            f'with {described(pattern)}, {beyond:.1%} of the light would be more than a fringe '
            f"beyond the projector's frame: {ADVICE}"
        )
    rows = np.flatnonzero(lit.any(axis=1))
    ends = lit[rows].argmax(axis=1), lit.shape[1] - 1 - lit[rows, ::-1].argmax(axis=1)
    at_ends = np.stack([phase[rows, end] for end in ends])
    telling = rims[pattern.code != 'stripe' :]
    at_rims = np.abs(at_ends - telling[:, None, None]) < 2 * np.pi
    return bool((at_rims.mean(axis=2) > _ROWS).any())


def described(pattern: Pattern) -> str:
    """Period and zero of a pattern, in words."""
    zero = 'the stripe' if pattern.code == 'stripe' else 'a crest'
    return f'a period of {pattern.period_px:g} px with {zero} at {pattern.stripe_center_px:g}'
