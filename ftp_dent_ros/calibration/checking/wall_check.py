"""Whether a rig still holds, from one photograph of a flat wall or a smooth skin in its pattern.

Fringes along one axis give three equations for three unknowns, so a wrong rig gives a cloud all
the same. Two things betray it: the rim of the projector's frame, whose rows are known, and that a
wall is flat. The projector's turn against the camera is estimated from both, with the wall's place
as an unknown; from the rim alone on a skin, whose form the fringes tell. Where the middle of a
blurred edge seems to be depends on how straight the camera's response is: an unknown that both
rims share. A shift of all columns alike leaves a wall flat (planes stay planes in projective
geometry) and only moves it: a board shows that too, see `board_check`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from ftp_dent_ros.calibration.checking.rim import Rim, find_rim, inverse_depth
from ftp_dent_ros.calibration.checking.verdict import Check, judged, turn_covariance, turned
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

# A fitted quadratic follows a wall to this, if it is not known to be flatter; metres.
_SMOOTH = 5e-5
# Fringes are known to this at first and at best, projector pixels.
PHASE_PX, PHASE_LEAST = 0.03, 0.003
# Half of the levels is half of the light to this part of the blur: for a camera whose exponent is
# known to 10 % (0.35 of it over the edge's slope, 0.4).
_RESPONSE = 0.09
# A rim's places are known to this at best, projector rows, and at first.
_RIM_LEAST, _RIM_FIRST = 0.01, 0.15
_ROUNDS = 3
# A residual beyond so many standard deviations is another thing's edge: 1 of 16,000 of noise is.
_FAR = 4.0
# Numbers that the places of the rims tell beside their own noise: three turns, the response.
_RIM_UNKNOWN = 4
# Neighbours err together: as if there were a tenth as many (its square).
_ALIKE = np.sqrt(10)
_MOST_POINTS = 1500
# No projector has turned by more, radians: what tells nothing leaves this open.
ANY_TURN = 0.1
# Points of a skin that tell the column at a place of the rim near them.
_NEIGHBOURS = 40
# Rounds of the search for a ray's depth, and its relative step.
_NEWTON, _STEP = 4, 1e-4


def check(
    rig: Rig,
    pattern: Pattern,
    image: Photograph | NDArray,
    points: NDArray,
    flatness: float = 1e-4,
) -> Check:
    """Check a rig by a photograph.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    image : Photograph or ndarray
    points : ndarray, shape (rows, columns, 3)
        The cloud that was computed of it with `rig`, metres; NaN where there is none.
    flatness : float
        How far a wall's border may lie off the plane of its middle (standard deviation), metres:
        the yaw shows in nothing else. Infinite for a skin, of whose form nothing is known.

    Raises
    ------
    CalibrationError
        Too little was measured.
    """
    seen = points[np.isfinite(points).all(axis=-1)].astype(float)
    if len(seen) < 200:
        raise CalibrationError(
            f'{len(seen)} points were measured, fewer than 200: photograph a flat wall that fills '
            'the image'
        )
    # Of the two projector coordinates the fringes tell one, and their ends the other.
    told = 0 if pattern.axis == 'u' else 1
    shape, *_ = np.linalg.lstsq(inverse_depth(seen / seen[:, 2:]), 1 / seen[:, 2], rcond=None)
    rim = find_rim(rig, pattern, fringe_levels(image, rig), shape)
    flat = np.isfinite(flatness)
    surface = _wall(rig, told, seen, shape, rim, flatness) if flat else _skin(rig, told, seen, rim)
    rim_noise = np.full(len(rim), _RIM_FIRST)

    def off_rim(state: NDArray) -> NDArray[np.float64]:
        by = turned(rig, state[:3])
        points = surface.at_rim(by, state[4:])
        row = by.projector.project(by.to_projector(points))[:, 1 - told]
        return row - rim.rows - state[3] * rim.blur

    def residuals(state: NDArray) -> NDArray[np.float64]:
        rest = surface.misfit(turned(rig, state[:3]), state[4:])
        known = np.append(state[:3] / ANY_TURN, state[3] / _RESPONSE)
        return np.concatenate([rest, off_rim(state) / rim_noise, known])

    start = np.concatenate([np.zeros(4), surface.start])
    for _ in range(_ROUNDS):
        found = least_squares(residuals, start, x_scale='jac', loss='soft_l1', f_scale=2.0)
        start, off = found.x, off_rim(found.x)
        for side in rim.sides():
            rim_noise[side] = scatter(off[side], _RIM_LEAST)
    middle = np.median(seen, axis=0)
    freedom = max(1, len(rim) - _RIM_UNKNOWN) if len(rim) else None
    covariance = turn_covariance(found.jac)
    return judged(rig, pattern, found.x[:3], covariance, middle, len(rim), freedom)


@dataclass(frozen=True, eq=False)
class _Surface:
    """What lies before the rig, with numbers of its own that are estimated beside the turn.

    Attributes
    ----------
    start : ndarray, shape (k,)
        The numbers, to start from.
    misfit : callable
        Of a rig and the numbers: weighted residuals of the fringes and of what is known.
    at_rim : callable
        Of a rig and the numbers: points (n, 3) that the rim's pixels see, metres.
    """

    start: NDArray[np.float64]
    misfit: Callable[[Rig, NDArray], NDArray[np.float64]]
    at_rim: Callable[[Rig, NDArray], NDArray[np.float64]]


def _wall(
    rig: Rig, told: int, seen: NDArray, shape: NDArray, rim: Rim, flatness: float
) -> _Surface:
    """A plane that is bent by no more than it is known to be: its fringes tell the yaw."""
    seen = seen[:: max(1, len(seen) // _MOST_POINTS)]
    rays, rim_rays = seen / seen[:, 2:], _rays(rig, rim)
    columns = rig.projector.project(rig.to_projector(seen))[:, told]
    distance = float(np.median(seen[:, 2]))
    scale = rig.projector.camera_matrix[told, told] * np.linalg.norm(rig.translation)
    noise = _ALIKE * np.hypot(PHASE_PX, min(_SMOOTH, flatness) * scale / distance**2)
    reach = float(np.percentile(np.hypot(rays[:, 0], rays[:, 1]), 95))
    bend = flatness / distance**2 / reach**2

    def points(at: NDArray, numbers: NDArray) -> NDArray[np.float64]:
        return at / (inverse_depth(at) @ numbers)[:, None]

    def misfit(by: Rig, numbers: NDArray) -> NDArray[np.float64]:
        column = by.projector.project(by.to_projector(points(rays, numbers)))[:, told]
        return np.concatenate([(column - columns) / noise, numbers[3:] / bend])

    return _Surface(shape, misfit, lambda by, numbers: points(rim_rays, numbers))


def _skin(rig: Rig, told: int, seen: NDArray, rim: Rim) -> _Surface:
    """Of any form: the fringes tell where it is whatever the turn, and the rim alone the turn."""
    rays = _rays(rig, rim)
    near, columns = np.zeros(len(rim)), np.zeros(len(rim))
    if len(rim):
        pixels = rig.camera.project(seen)
        fringes = rig.projector.project(rig.to_projector(seen))[:, told]
        _, index = cKDTree(pixels).query(rim.pixels, k=_NEIGHBOURS)
        for i, (at, which) in enumerate(zip(rim.pixels, index, strict=True)):
            terms = np.column_stack([np.ones(len(which)), pixels[which] - at])
            known = np.column_stack([fringes[which], seen[which, 2]])
            (columns[i], near[i]), *_ = np.linalg.lstsq(terms, known, rcond=None)[0]

    def at_rim(by: Rig, numbers: NDArray) -> NDArray[np.float64]:
        depth = near
        for _ in range(_NEWTON):
            column, further = (
                by.projector.project(by.to_projector((depth * each)[:, None] * rays))[:, told]
                for each in (1, 1 + _STEP)
            )
            depth = depth * (1 + _STEP * (columns - column) / (further - column))
        return depth[:, None] * rays

    return _Surface(np.zeros(0), lambda by, numbers: np.zeros(0), at_rim)


def _rays(rig: Rig, rim: Rim) -> NDArray[np.float64]:
    return rig.camera.rays(rim.pixels) if len(rim) else np.zeros((0, 3))


def scatter(off: NDArray, least: float) -> float:
    """Standard deviation of residuals, without those that are far off by their quartiles."""
    low, middle, high = np.percentile(off, [25, 50, 75])
    near = np.abs(off - middle) <= _FAR * (high - low) / 1.349
    return max(least, float(np.std(off[near])))


def linear_photograph(image: Photograph | NDArray, rig: Rig) -> Photograph:
    """The photograph with levels that grow with the light, if the rig knows the response."""
    photograph = Photograph.of(image)
    return photograph if rig.response is None else photograph.linear(rig.response)


def fringe_levels(image: Photograph | NDArray, rig: Rig) -> NDArray[np.float64]:
    """Grey levels, shape (height, width), of the colour that all fringes have: red.

    They grow with the light if the rig knows the camera's response.
    """
    photograph = linear_photograph(image, rig)
    return photograph.rgb()[..., 0].astype(float) * photograph.unit
