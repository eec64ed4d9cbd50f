"""Whether a rig still holds, from one photograph of a flat wall, a board or a smooth skin.

Fringes along one axis give three equations for three unknowns, so a wrong rig gives a cloud all
the same. What betrays it is known beside them: the rows of the rim of the projector's frame, that
a wall is flat, and where the corners of a board are. The projector's turn against the camera is
estimated from them, with the surface's place as an unknown; on a skin, whose form the fringes
tell, from the rim alone. A shift of all columns alike leaves a wall flat (planes stay planes in
projective geometry) and only moves it: a board shows that too.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.board_in_fringes import (
    board_pose,
    fringe_levels,
    linear_photograph,
    read_board,
)
from ftp_dent_ros.calibration.bundle import bend_terms, depths_along, inverse_of
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

AXES = ('pitch', 'yaw', 'roll')
# x and y of frames, and what turns about them, in each other's place.
_SWAPPED = [1, 0, 2]

# Fewer places than this are no rim.
_FEWEST = 12
# Half the length of a profile across the rim, camera pixels.
_REACH = 14
# A place so many projector pixels inside the rim tells which way is inward.
_INWARD = 8.0

# Standard deviations at first and at best: of a rim's places and of fringes, projector pixels; of
# corners through fringes, camera pixels.
_RIM, _FRINGES, _CORNERS = (0.15, 0.01), (0.03, 0.003), (0.05, 0.01)
# No projector has turned by more, radians: what tells nothing leaves this open.
_ANY_TURN = 0.1


@dataclass(frozen=True, eq=False)
class Check:
    """What one photograph says of a rig.

    Attributes
    ----------
    turn : ndarray, shape (3,)
        Of the projector about its x (pitch), y (yaw) and z (roll), radians, as it seems.
    deviation : ndarray, shape (3,)
        Standard deviation of the turn, radians.
    drift_px : ndarray, shape (3,)
        The same at the frame's border, projector pixels.
    depth_error : float
        What the turn, where it is sure, does to the depth at the wall, metres.
    rim_points : int
        Places at which the frame's upper and lower rim was seen.
    unknown : tuple of str
        Axes about which the photograph says nothing.
    moved : tuple of str
        Axes about which the projector has moved, surely.
    camera_px : float
        Distance of a board's corners from where the camera's lens model has them, root mean
        square, by the nearest four fifths of them; None if no board was seen.
    """

    turn: NDArray[np.float64]
    deviation: NDArray[np.float64]
    drift_px: NDArray[np.float64]
    depth_error: float
    rim_points: int
    unknown: tuple[str, ...]
    moved: tuple[str, ...]
    camera_px: float | None = None

    @property
    def camera_holds(self) -> bool:
        """Whether the camera's lens model fits, as far as a board shows."""
        # Corners of a board, through fringes, fit a lens that holds to a tenth of a pixel; RMS,
        # pixels.
        return self.camera_px is None or self.camera_px <= 0.25

    @property
    def holds(self) -> bool:
        """Whether nothing moved that was seen."""
        return self.camera_holds and not self.moved

    @property
    def tells(self) -> bool:
        """Whether anything was seen that would have shown a move."""
        return self.camera_px is not None or len(self.unknown) < len(AXES)

    @property
    def sentence(self) -> str:
        """For people."""
        if not self.camera_holds:
            return (
                f"the rig does not hold: the board's corners are {self.camera_px:.2f} pixels from "
                "where the camera's lens model has them: see that the board is the one given; "
                'else the lens has changed: calibrate again'
            )
        if self.moved:
            parts = [
                f'{axis} {np.degrees(self.turn[AXES.index(axis)]):+.3f} degrees '
                f'({abs(self.drift_px[AXES.index(axis)]):.1f} pixels)'
                for axis in self.moved
            ]
            return (
                f'the rig does not hold: the projector has turned, {", ".join(parts)}; depths are '
                f'off by {1e3 * self.depth_error:.2f} mm: calibrate again, or adjust it'
            )
        if not self.tells:
            return (
                'whether the rig holds, this photograph does not tell: bring the upper or lower '
                "rim of the projector's frame into view, or show a board"
            )
        blind = list(self.unknown)
        if self.camera_px is None:
            blind.append('a shift across the fringes, which a board shows')
        said = 'the rig holds, as far as this photograph tells'
        return f'{said}; it tells nothing of {", ".join(blind)}' if blind else said


def judged(
    rig: Rig,
    pattern: Pattern,
    turn: NDArray,
    covariance: NDArray,
    middle: NDArray,
    rim_points: int = 0,
    camera_px: float | None = None,
) -> Check:
    """What an estimated turn says.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    turn, covariance : ndarray, shape (3,) and (3, 3)
        Of the projector, radians; what the rig's calibration leaves open is added.
    middle : ndarray, shape (3,)
        A point in the middle of what was measured, metres.
    rim_points : int
        Behind the covariance's scale; 0 if it is as good as known.
    camera_px : float, optional
        As of `Check`.
    """
    # False alarms wanted, of all photographs of true rigs: either way about one of three axes.
    chance = 1e-4 / 2 / 3
    # A scale that few places tell needs Student's t: three turns and the response are theirs too.
    sure = -float(stdtrit(max(1, rim_points - 4) if rim_points else np.inf, chance))
    if rig.record is not None and rig.record.covariance is not None:
        covariance = covariance + rig.record.covariance[18:21, 18:21]
    deviation = np.sqrt(np.diag(covariance))
    lens = rig.projector
    lever = np.array([*lens.camera_matrix[[1, 0], [1, 0]], np.hypot(lens.width, lens.height) / 2])
    drift, doubt = turn * lever, deviation * lever
    # Worse known than this it is not known, projector pixels.
    unknown = doubt > 1.2
    # Smaller drifts, projector pixels, are not worth another calibration: they leave dents as deep
    # as they are and move a cloud at 0.75 m by half a millimetre.
    moved = ~unknown & (np.abs(drift) > np.maximum(0.4, sure * doubt))
    true = turned(rig, np.where(moved, turn, 0))
    if pattern.axis == 'v':
        rig, true, middle = rig.transposed, true.transposed, middle[_SWAPPED]
    column = rig.projector.project(rig.to_projector(middle[None]))[:, 0]
    depth = float(depths_along(true, middle[None] / middle[2], column)[0])
    return Check(
        turn,
        deviation,
        drift,
        abs(depth - float(middle[2])),
        rim_points,
        tuple(compress(AXES, unknown)),
        tuple(compress(AXES, moved)),
        camera_px,
    )


def adjusted(rig: Rig, found: Check) -> Rig:
    """The rig with the projector turned as a check says, about the axes that it is sure of."""
    sure = np.array([axis not in found.unknown for axis in AXES])
    return replace(turned(rig, np.where(sure, found.turn, 0)), record=None)


def turned(rig: Rig, turn: NDArray) -> Rig:
    """The rig with its projector turned about its own centre by a rotation vector, radians."""
    by = Rotation.from_rotvec(turn).as_matrix()
    return replace(rig, rotation=by @ rig.rotation, translation=by @ rig.translation)


#: Of residuals of one kind: their standard deviation at first, and how it is estimated then.
_Kind = tuple[float, Callable[[NDArray], float]]
#: A prior's, which are in standard deviations.
_PRIOR: _Kind = 1.0, lambda off: 1.0
#: Residuals of each kind, which show the turn, of a rig and the other unknowns.
_Misfit = Callable[[Rig, NDArray], list[NDArray]]


def _fitted(
    rig: Rig, misfit: _Misfit, start: NDArray, kinds: list[_Kind]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Robust least squares of residuals of several kinds, each as good as it turns out to be.

    Parameters
    ----------
    rig : Rig
    misfit : callable
    start : ndarray
        Of the unknowns beside the turn.
    kinds : list of _Kind

    Returns
    -------
    unknowns : ndarray
        The projector's turn, and the others.
    covariance : ndarray, shape (3, 3)
        Of the turn.
    """
    deviations = [first for first, _ in kinds]
    unknowns = np.concatenate([np.zeros(3), start])

    def each(unknowns: NDArray) -> list[NDArray]:
        return misfit(turned(rig, unknowns[:3]), unknowns[3:])

    def weighted(unknowns: NDArray) -> NDArray[np.float64]:
        off = zip(each(unknowns), deviations, strict=True)
        return np.concatenate([unknowns[:3] / _ANY_TURN, *(part / spread for part, spread in off)])

    for _ in range(3):
        found = least_squares(weighted, unknowns, x_scale='jac', loss='soft_l1', f_scale=2.0)
        unknowns = found.x
        parts = zip(kinds, each(unknowns), strict=True)
        deviations = [spread(off) for (_, spread), off in parts]
    return unknowns, inverse_of(found.jac.T @ found.jac)[:3, :3]


def scatter(off: NDArray, least: float) -> float:
    """Standard deviation of residuals, without those that are far off by their quartiles."""
    low, middle, high = np.percentile(off, [25, 50, 75])
    # A residual beyond so many standard deviations is another thing's edge: 1 of 16,000 of noise
    # is.
    near = np.abs(off - middle) <= 4.0 * (high - low) / 1.349
    return max(least, float(np.std(off[near])))


def check(
    rig: Rig,
    pattern: Pattern,
    image: Photograph | NDArray,
    points: NDArray,
    flatness: float = 1e-4,
) -> Check:
    """Check a rig by a photograph of a wall or a skin.

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
    levels, middle = fringe_levels(linear_photograph(image, rig)), np.median(seen, axis=0)
    if pattern.axis == 'u':
        turn, covariance, places = _turn(rig, pattern, levels, seen, flatness)
    else:
        # The same with x for y, which turns a turn around.
        swapped = rig.transposed, pattern.transposed, levels.T, seen[:, _SWAPPED], flatness
        turn, covariance, places = _turn(*swapped)
        turn, covariance = -turn[_SWAPPED], covariance[np.ix_(_SWAPPED, _SWAPPED)]
    return judged(rig, pattern, turn, covariance, middle, places)


def _turn(
    rig: Rig, pattern: Pattern, levels: NDArray, seen: NDArray, flatness: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """The projector's turn, its covariance, and the places on rims, of upright fringes.

    The fringes tell the depth whatever the turn: a place on the rim has a row then, and a wall's
    inverse depths are linear in the rays, up to its bend.
    """
    rays = seen / seen[:, 2:]
    shape, *_ = np.linalg.lstsq(_inverse_depth(rays), 1 / seen[:, 2], rcond=None)
    pixels, rows, blur = _find_rim(rig, pattern, levels, shape)
    rim_rays = rig.camera.rays(pixels)
    columns = rig.projector.project(rig.to_projector(seen))[:, 0]
    # By the nearest points, so smooth that it is the plane in which they lie about there.
    nearby = RBFInterpolator(rays[:, :2], columns, 40, smoothing=1e3, kernel='linear', degree=1)
    rim_columns = nearby(rim_rays[:, :2])
    rims = np.unique(rows)
    thin = slice(None, None, max(1, len(seen) // 1500))
    rays, columns = rays[thin], columns[thin]
    distance = float(np.median(seen[:, 2]))
    reach = float(np.percentile(np.hypot(rays[:, 0], rays[:, 1]), 95))

    def misfit(by: Rig, unknowns: NDArray) -> list[NDArray]:
        points = rim_rays * depths_along(by, rim_rays, rim_columns)[:, None]
        off = by.projector.project(by.to_projector(points))[:, 1] - rows - unknowns[0] * blur
        # Half of the levels is half of the light to this part of the blur: for a camera whose
        # exponent is known to 10 % (0.35 of it over the edge's slope, 0.4).
        return [*(off[rows == rim] for rim in rims), unknowns[:1] / 0.09]

    def on_wall(by: Rig, unknowns: NDArray) -> list[NDArray]:
        points = rays / (_inverse_depth(rays) @ unknowns[1:])[:, None]
        off = by.projector.project(by.to_projector(points))[:, 0] - columns
        return [*misfit(by, unknowns), off, unknowns[4:] * (distance * reach) ** 2 / flatness]

    kinds: list[_Kind] = [(_RIM[0], lambda off: scatter(off, _RIM[1]))] * len(rims) + [_PRIOR]
    if not np.isfinite(flatness):
        found, covariance = _fitted(rig, misfit, np.zeros(1), kinds)
    else:
        # A fitted quadratic follows a wall to 0.05 mm, if it is not known to be flatter.
        depth = rig.projector.camera_matrix[0, 0] * np.linalg.norm(rig.translation) / distance**2
        # Neighbours err together: as if there were a tenth as many.
        noise = np.sqrt(10) * float(np.hypot(_FRINGES[0], min(5e-5, flatness) * depth))
        kinds += [(noise, lambda off: noise), _PRIOR]
        found, covariance = _fitted(rig, on_wall, np.concatenate([[0.0], shape]), kinds)
    return found[:3], covariance, len(rows)


def _inverse_depth(rays: NDArray) -> NDArray[np.float64]:
    """Terms of a surface's inverse depth along rays: three of a plane, three of its bend."""
    x, y = rays[:, 0], rays[:, 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def _find_rim(
    rig: Rig, pattern: Pattern, levels: NDArray, shape: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places on the two rims of the frame at which upright fringes end.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    levels : ndarray, shape (height, width)
        Of the photograph, growing with the light.
    shape : ndarray, shape (6,)
        Of the surface, as in `_inverse_depth`.

    Returns
    -------
    pixels : ndarray, shape (n, 2)
        Of the camera: where the light is half of what it is inside; n is 0 if too few are seen.
    rows : ndarray, shape (n,)
        Projector rows of these rims.
    blur : ndarray, shape (n,)
        Standard deviation of the edge's blur, projector rows, positive if the frame is below.
    """
    width, height = rig.projector.width, rig.projector.height
    bright = np.arange(pattern.stripe_center_px % pattern.period_px, width, pattern.period_px)
    columns, rows = np.tile(bright, 2), np.repeat([-0.5, height - 0.5], len(bright))
    inward = np.sign(height / 2 - rows) * _INWARD
    at, inside = (
        _lit(rig, np.column_stack([columns, rows + step]), shape) for step in (0, inward)
    )
    length = np.maximum(np.linalg.norm(inside - at, axis=1), 1e-9)
    way = (inside - at) / length[:, None]
    offsets = np.arange(-_REACH, _REACH + 0.25, 0.25)
    where = np.moveaxis(at[:, None] + offsets[:, None] * way[:, None], -1, 0)[::-1]
    profiles = map_coordinates(levels, np.nan_to_num(where, nan=-1), cval=np.nan)
    edges = np.array([_edge(profile, offsets) for profile in profiles])
    seen = np.isfinite(edges[:, 0])
    seen &= seen.sum() >= _FEWEST
    places = (at + edges[:, :1] * way)[seen]
    return places, rows[seen], (edges[:, 1] * inward / length)[seen]


def _edge(profile: NDArray, offsets: NDArray) -> tuple[float, float]:
    """Where a profile is half dark, half light, and its blur's deviation; NaN without an edge."""
    dark, light = np.median(profile[:16]), np.median(profile[-24:])
    share = (profile - dark) / np.maximum(light - dark, 1e-9)
    above = share > 0.5
    crossings = np.flatnonzero(~above[:-1] & above[1:])
    # From the dark around the frame to the light in it, at least, grey levels.
    if not light - dark >= 8.0 or light > 250 or len(crossings) != 1:
        return np.nan, np.nan
    index = crossings[0]
    first = index - int(np.argmax(share[index::-1] <= 0.25))
    last = index + int(np.argmax(share[index + 1 :] >= 0.75))
    before, middle, behind = (
        np.interp(level, share[at : at + 2], offsets[at : at + 2])
        for level, at in ((0.25, first), (0.5, index), (0.75, last))
    )
    # Quartiles of a normal distribution are so many standard deviations apart.
    return float(middle), float(behind - before) / 1.349


def _lit(rig: Rig, pixels: NDArray, shape: NDArray) -> NDArray[np.float64]:
    """Camera pixels that see what projector pixels light on the surface."""
    rays = rig.projector.rays(pixels) @ rig.rotation
    centre = rig.projector_centre
    scale = np.full(len(rays), 1 / shape[0])
    for _ in range(20):
        points = centre + scale[:, None] * rays
        depth = 1 / (_inverse_depth(points / points[:, 2:]) @ shape)
        scale += (depth - points[:, 2]) / rays[:, 2]
    return rig.camera.project(centre + scale[:, None] * rays)


def check_by_board(
    rig: Rig,
    pattern: Pattern,
    board: Board,
    image: Photograph | NDArray,
    flatness: float = 1e-4,
) -> Check:
    """Check a rig by a photograph of a board.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    board : Board
        The one that the rig was calibrated with, or one whose squares are as well known.
    image : Photograph or ndarray
    flatness : float
        How far the board's border may lie off the plane of its middle, metres, standard
        deviation.

    Raises
    ------
    CalibrationError
        The board is not seen, or too little of it was measured.
    """
    axis = 'uv'.index(pattern.axis)
    corners, points, columns = read_board(rig, pattern, board, image)
    known, lit = np.isfinite(corners[:, 0]), np.isfinite(columns)
    corners, columns, points = corners[known], columns[lit], points[lit]
    rays = points / points[:, 2:]
    bending = bend_terms(board.points)[:, 2] / 2

    def misfit(by: Rig, unknowns: NDArray) -> list[NDArray]:
        turn, shift, scale = Rotation.from_rotvec(unknowns[:3]), unknowns[3:6], unknowns[6]
        bend = bending @ unknowns[7:]
        bent = board.points * scale + np.outer(bend, [0, 0, 1])
        off = rig.camera.project(turn.apply(bent[known]) + shift) - corners
        normal = turn.apply([0.0, 0.0, 1.0])
        depth = (shift @ normal + bend[lit]) / (rays @ normal)
        pixel = by.projector.project(by.to_projector(depth[:, None] * rays))[:, axis]
        # Warmth and damp make a print so much larger or smaller: aluminium by 12, paper by 30
        # kelvin.
        prior = [(scale - 1) / 3e-4, *unknowns[7:] / flatness]
        return [off[:, 0], off[:, 1], pixel - columns, np.array(prior)]

    corner_noise = partial(_corner_noise, known.reshape(board.rows, board.columns))

    corner = _CORNERS[0], corner_noise
    fringes: _Kind = _FRINGES[0], lambda off: scatter(off, _FRINGES[1])
    turn, shift = board_pose(rig, board.points[known], corners)
    start = np.concatenate([turn.as_rotvec(), shift, [1.0], np.zeros(3)])
    found, covariance = _fitted(rig, misfit, start, [corner, corner, fringes, _PRIOR])
    # A lens that has changed moves most corners, a shadow or the frame's rim a few: the nearest of
    # them tell, which are this part of the mean square of normally distributed vectors in the
    # plane: 1 - q exp(-q) / (1 - exp(-q)), with q = ln 5.
    near = np.sort(np.hypot(*misfit(rig, found[3:])[:2]))[: max(1, int(0.8 * known.sum()))]
    camera_px = float(np.sqrt(np.mean(near**2) / 0.598))
    middle = np.median(points, axis=0)
    return judged(rig, pattern, found[:3], covariance, middle, camera_px=camera_px)


def _corner_noise(seen: NDArray[np.bool_], residuals: NDArray) -> float:
    """Of residuals, as if they were independent: edges along fringes err alike.

    Which of the board's corners (rows, columns) are theirs, `seen` tells.

    The variance of a mean of residuals that fade with the distance by a factor r a corner is
    (1 + r) / (1 - r) times as large along each axis.
    """
    spread, off = scatter(residuals, _CORNERS[1]), np.full(seen.shape, np.nan)
    off[seen] = np.clip(residuals, -3 * spread, 3 * spread)
    factor = 1.0
    for first, second in ((off[1:], off[:-1]), (off[:, 1:], off[:, :-1])):
        ratio = np.nanmean(first * second) / np.nanmean(off**2)
        # Neighbouring corners that err more alike than this are one; their correlation.
        ratio = np.clip(ratio, 0, 0.8)
        factor *= (1 + ratio) / (1 - ratio)
    return float(np.sqrt(np.nanmean(off**2) * factor))


class CheckAside:
    """Checks of a rig, each in a process of its own, behind whatever else runs.

    SciPy's optimisers take some tenths of a second, much of it in Python: in a thread they would
    hold up the photographs that come meanwhile.
    """

    _process: subprocess.Popen[bytes] | None = None

    def check(self, *given: Any) -> Check:
        """Check a rig as `check` does, of whose arguments these are.

        Raises
        ------
        CalibrationError
            Too little was measured, or the process did not come to an end.
        """
        self._process = process = subprocess.Popen(
            [sys.executable, '-c', f'from {__name__} import answer; answer()'],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        answered, _ = process.communicate(pickle.dumps(given))
        if process.returncode:
            raise CalibrationError(f'its process ended with the status {process.returncode}')
        found = pickle.loads(answered)
        if isinstance(found, CalibrationError):
            raise found
        return found

    def end(self) -> None:
        """End the check under way."""
        if self._process is not None:
            self._process.kill()


def answer() -> None:
    """Check what comes in on the standard input; what is found, or why not, goes out."""
    # The last priority there is: photographs go first.
    os.nice(19)
    found: Any = None
    try:
        found = check(*pickle.load(sys.stdin.buffer))
    except CalibrationError as reason:
        found = reason
    pickle.dump(found, sys.stdout.buffer)
