"""Whether the light lies in the projector's frame, and ends where the frame does.

Vertical fringes give three equations for the three unknowns of each point, so that a wrong period
looks like a tilted surface, and a wrong stripe like another distance. The frame tells: a surface
may end before its rim, but light is nowhere beyond it. Where rows end at the rim itself, within a
fringe, the pattern is the given one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.rig.rig import Rig

# Share of the light more than a fringe beyond the frame: edges of shadows leave 0.002 there.
_BEYOND = 0.005
# Share of the rows that end at a rim: it is their end, and no spot's.
_ROWS = 0.25
#: What to do about another pattern.
ADVICE = (
    'do not mirror or turn the photograph, and give the pattern that is projected (pattern.yaml) '
    'and the rig that it is projected with'
)


def check_frame(
    rig: Rig,
    pattern: Pattern,
    rays: NDArray[np.float32],
    phase: NDArray[np.floating],
    lit: NDArray[np.bool_],
) -> bool:
    """Raise the reason if the light cannot be that of the given frame.

    Parameters
    ----------
    rays : ndarray, shape (rows, columns, 2 or 3), float32
        The camera's undistorted rays, z = 1.
    phase : ndarray, shape (rows, columns)
        Absolute, radians; of `lit` only.
    lit : ndarray, shape (rows, columns), bool
        Where there are numbered fringes.

    Returns
    -------
    bool
        Whether it can be no other's: the left or right rim of the frame is seen in its place, of
        coded fringes that behind the last one, as the code begins with the first one.

    Raises
    ------
    OtherPatternError
    """
    place = np.flatnonzero(lit)
    some = np.ones((1, len(place), 3), np.float32)
    some[0, :, :2] = rays.reshape(-1, rays.shape[-1])[place, :2]
    u_p = pattern.column(phase.ravel()[place])
    _, v_p = triangulate(rig, some, u_p[None].astype(np.float32))
    inside = np.minimum(_within(u_p, pattern.width), _within(v_p[0], pattern.height))
    beyond = np.mean(~(inside > -pattern.period_px))  # what meets nothing is there, too
    if beyond > _BEYOND:
        raise OtherPatternError(
            f'with {described(pattern)}, {beyond:.1%} of the light would be more than a fringe '
            f"beyond the projector's frame: {ADVICE}"
        )
    return _ends_at_rim(pattern, phase, lit)


def described(pattern: Pattern) -> str:
    """Period and zero of a pattern, in words."""
    zero = 'the stripe' if pattern.code == 'stripe' else 'a crest'
    return f'a period of {pattern.period_px:g} px with {zero} at {pattern.stripe_center_px:g}'


def _within(places: NDArray, size: int) -> NDArray:
    """Pixels from the nearer rim, less than 0 beyond it."""
    return np.minimum(places, size - 1 - places) + 0.5


def _ends_at_rim(pattern: Pattern, phase: NDArray, lit: NDArray[np.bool_]) -> bool:
    """Whether many rows end within a fringe of a rim that tells the period."""
    rows = np.flatnonzero(lit.any(axis=1))
    ends = lit[rows].argmax(axis=1), lit.shape[1] - 1 - lit[rows, ::-1].argmax(axis=1)
    rims = pattern.phase([-0.5, pattern.width - 0.5])[pattern.code != 'stripe' :]
    at_ends = np.stack([phase[rows, end] for end in ends])
    at_rims = np.abs(at_ends - rims[:, None, None]) < 2 * np.pi
    return bool((at_rims.mean(axis=2) > _ROWS).any())
