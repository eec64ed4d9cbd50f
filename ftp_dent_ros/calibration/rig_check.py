"""Whether a rig still holds, from one photograph of a flat wall or a smooth skin.

Fringes along one axis give three equations for three unknowns, so a wrong rig gives a cloud all
the same. Two things betray it: the rim of the projector's frame, whose rows are known, and that a
wall is flat. The projector's turn against the camera is estimated from both, with the wall's place
as an unknown; from the rim alone on a skin, whose form the fringes tell. A shift of all columns
alike leaves a wall flat (planes stay planes in projective geometry) and only moves it: a board
shows that too, see `board_check`.
"""

from __future__ import annotations

import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import norm, t

from ftp_dent_ros.calibration.bundle import depth_deviation, depths_along
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

# Worse known than this it is not known, projector pixels.
_UNKNOWN_PX = 1.2
AXES = ('pitch', 'yaw', 'roll')
# x and y of frames, and what turns about them, in each other's place.
_SWAPPED = [1, 0, 2]

# Fewer places than this are no rim.
_FEWEST = 12
# Half the length of a profile across the rim, camera pixels.
_REACH = 14
# A place so many projector pixels inside the rim tells which way is inward.
_INWARD = 8.0
# A rim's places are known to this at first and at best, projector rows.
_RIM_FIRST, _RIM_LEAST = 0.15, 0.01

# Fringes are known to this at first and at best, projector pixels.
PHASE_PX, PHASE_LEAST = 0.03, 0.003
# A residual beyond so many standard deviations is another thing's edge: 1 of 16,000 of noise is.
_FAR = 4.0
# Neighbours err together: as if there were a tenth as many (its square).
_ALIKE = np.sqrt(10)
# No projector has turned by more, radians: what tells nothing leaves this open.
ANY_TURN = 0.1
# Seconds of processor time of a check aside, of which it takes some tenths.
_LONGEST = 120


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
        square, told by the nearest four fifths of them; None if no board was seen.
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
        """Whether the camera's lens model fits, as far as a board told."""
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
        if self.camera_px is not None and not self.camera_holds:
            return (
                f"the rig does not hold: the board's corners are {self.camera_px:.2f} pixels from "
                "where the camera's lens model has them: see that the board is the one told; "
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
    freedom: int | None = None,
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
    freedom : int, optional
        Degrees of freedom that the covariance's scale was told by; as good as known without.
    """
    # Either way about one of three axes: a scale that few places tell needs Student's t.
    # False alarms wanted, of all photographs of true rigs.
    chance = 1e-4 / 2 / 3
    sure = float(norm.isf(chance) if freedom is None else t.isf(chance, freedom))
    if rig.record is not None and rig.record.covariance is not None:
        covariance = covariance + rig.record.covariance[18:21, 18:21]
    deviation = np.sqrt(np.diag(covariance))
    lens = rig.projector
    lever = np.array([*lens.camera_matrix[[1, 0], [1, 0]], np.hypot(lens.width, lens.height) / 2])
    drift, doubt = turn * lever, deviation * lever
    unknown = tuple(a for a, each in zip(AXES, doubt, strict=True) if each > _UNKNOWN_PX)
    # Smaller drifts, projector pixels, are not worth another calibration: they leave dents as deep
    # as they are and move a cloud at 0.75 m by half a millimetre.
    moved = tuple(
        axis
        for axis, each, spread in zip(AXES, np.abs(drift), doubt, strict=True)
        if axis not in unknown and each > max(0.4, sure * spread)
    )
    error = 0.0
    if moved:
        off = np.where([axis in moved for axis in AXES], turn, 0)
        if pattern.axis == 'v':
            rig, off, middle = rig.transposed, off[_SWAPPED], middle[_SWAPPED]
        shift = np.zeros((24, 24))
        shift[18:21, 18:21] = np.diag(off**2)
        error = float(depth_deviation(rig, shift, rig.camera.project(middle)[None], middle[2:])[0])
    return Check(turn, deviation, drift, error, rim_points, unknown, moved)


def adjusted(rig: Rig, found: Check) -> Rig:
    """The rig with the projector turned as a check says, about the axes that it is sure of."""
    sure = np.array([axis not in found.unknown for axis in AXES])
    return replace(turned(rig, np.where(sure, found.turn, 0)), record=None)


def turned(rig: Rig, turn: NDArray) -> Rig:
    """The rig with its projector turned about its own centre by a rotation vector, radians."""
    by = Rotation.from_rotvec(turn).as_matrix()
    return replace(rig, rotation=by @ rig.rotation, translation=by @ rig.translation)


#: Of residuals, their standard deviation; None for those that are in standard deviations.
Scatter = Callable[[NDArray], NDArray | float] | None


def fitted(
    misfit: Callable[[NDArray], list[NDArray]],
    start: NDArray,
    deviations: list[NDArray | float],
    scatters: list[Scatter],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Robust least squares of residuals of several kinds, each as good as it turns out to be.

    Parameters
    ----------
    misfit : callable
        Of the unknowns, of which the first three are the projector's turn: residuals by kind.
    start : ndarray
    deviations : list of float or ndarray
        Standard deviations of each kind, to start from.
    scatters : list of callable, optional

    Returns
    -------
    unknowns : ndarray
    covariance : ndarray, shape (3, 3)
        Of the turn.
    """

    def weighted(unknowns: NDArray) -> NDArray[np.float64]:
        kinds = zip(misfit(unknowns), deviations, strict=True)
        return np.concatenate([kind / spread for kind, spread in kinds])

    for _ in range(3):
        found = least_squares(weighted, start, x_scale='jac', loss='soft_l1', f_scale=2.0)
        start = found.x
        kinds = zip(misfit(start), deviations, scatters, strict=True)
        deviations = [tell(kind) if tell else spread for kind, spread, tell in kinds]
    normal = found.jac.T @ found.jac
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True)
    return start, (inverse * np.outer(scale, scale))[:3, :3]


@dataclass(frozen=True, eq=False)
class Rim:
    """Places on the rims of the frame.

    Attributes
    ----------
    pixels : ndarray, shape (n, 2)
        Of the camera: where the light is half of what it is inside.
    rows : ndarray, shape (n,)
        Projector rows of these rims.
    blur : ndarray, shape (n,)
        Standard deviation of the edge's blur, projector rows, positive if the frame is below.
    """

    pixels: NDArray[np.float64]
    rows: NDArray[np.float64]
    blur: NDArray[np.float64]


def inverse_depth(rays: NDArray) -> NDArray[np.float64]:
    """Terms of the inverse depth along rays: three of a plane, three of its bend."""
    x, y = rays[:, 0], rays[:, 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def find_rim(rig: Rig, pattern: Pattern, levels: NDArray, shape: NDArray) -> Rim:
    """Places on the two rims of the frame at which upright fringes end.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    levels : ndarray, shape (height, width)
        Of the photograph, growing with the light.
    shape : ndarray, shape (6,)
        Of the surface, as in `inverse_depth`.

    Returns
    -------
    Rim
        Without a place where too few are seen.
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
    return Rim(places, rows[seen], (edges[:, 1] * inward / length)[seen])


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
        depth = 1 / (inverse_depth(points / points[:, 2:]) @ shape)
        scale += (depth - points[:, 2]) / rays[:, 2]
    return rig.camera.project(centre + scale[:, None] * rays)


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
    levels, middle = fringe_levels(image, rig), np.median(seen, axis=0)
    if pattern.axis == 'u':
        turn, covariance, places = _turn(rig, pattern, levels, seen, flatness)
    else:
        # The same with x for y, which turns a turn around.
        swapped = rig.transposed, pattern.transposed, levels.T, seen[:, _SWAPPED], flatness
        turn, covariance, places = _turn(*swapped)
        turn, covariance = -turn[_SWAPPED], covariance[np.ix_(_SWAPPED, _SWAPPED)]
    # Numbers that the places of the rims tell beside their own noise: three turns, the response.
    freedom = max(1, places - 4) if places else None
    return judged(rig, pattern, turn, covariance, middle, places, freedom)


def _turn(
    rig: Rig, pattern: Pattern, levels: NDArray, seen: NDArray, flatness: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """The projector's turn, its covariance, and the places on rims, of upright fringes.

    The fringes tell the depth whatever the turn: a place on the rim has a row then, and a wall's
    inverse depths are linear in the rays, up to its bend.
    """
    rays = seen / seen[:, 2:]
    shape, *_ = np.linalg.lstsq(inverse_depth(rays), 1 / seen[:, 2], rcond=None)
    rim = find_rim(rig, pattern, levels, shape)
    columns = rig.projector.project(rig.to_projector(seen))[:, 0]
    rim_rays = rig.camera.rays(rim.pixels)
    rim_columns = _columns_near(rig.camera.project(seen), columns, rim.pixels)
    sides = [rim.rows == row for row in np.unique(rim.rows)]
    flat = bool(np.isfinite(flatness))
    start = np.concatenate([np.zeros(4), shape * flat])
    thin = slice(None, None, max(1, len(seen) // 1500))
    rays, columns = rays[thin], columns[thin]
    distance = float(np.median(seen[:, 2]))
    per_depth = rig.projector.camera_matrix[0, 0] * np.linalg.norm(rig.translation)
    # A fitted quadratic follows a wall to this, if it is not known to be flatter; metres.
    noise = _ALIKE * np.hypot(PHASE_PX, min(5e-5, flatness) * per_depth / distance**2)
    reach = float(np.percentile(np.hypot(rays[:, 0], rays[:, 1]), 95))

    def misfit(unknowns: NDArray) -> list[NDArray]:
        by = turned(rig, unknowns[:3])
        points = rim_rays * depths_along(by, rim_rays, rim_columns)[:, None]
        row = by.projector.project(by.to_projector(points))[:, 1]
        off = row - rim.rows - unknowns[3] * rim.blur
        # Half of the levels is half of the light to this part of the blur: for a camera whose
        # exponent is known to 10 % (0.35 of it over the edge's slope, 0.4).
        prior = [*unknowns[:3] / ANY_TURN, unknowns[3] / 0.09]
        kinds = [off[side] for side in sides]
        if flat:
            beside = 1 / depths_along(by, rays, columns) - inverse_depth(rays) @ unknowns[4:]
            kinds.append(beside * per_depth / noise)
            prior += [*unknowns[7:] * (distance * reach) ** 2 / flatness]
        return [*kinds, np.array(prior)]

    rest = 1 + flat
    deviations: list[Any] = [_RIM_FIRST] * len(sides) + [1.0] * rest
    scatters: list[Scatter] = [*[_rim_scatter] * len(sides), *[None] * rest]
    found, covariance = fitted(misfit, start[: 10 if flat else 4], deviations, scatters)
    return found[:3], covariance, len(rim.rows)


def _columns_near(pixels: NDArray, columns: NDArray, places: NDArray) -> NDArray[np.float64]:
    """Columns at places of the image by the nearest points, which lie in a plane about there."""
    result = np.zeros(len(places))
    _, nearest = cKDTree(pixels).query(places, k=40)
    for index, near in enumerate(nearest):
        terms = np.column_stack([np.ones(len(near)), pixels[near] - places[index]])
        result[index] = np.linalg.lstsq(terms, columns[near], rcond=None)[0][0]
    return result


def _rim_scatter(off: NDArray) -> float:
    return scatter(off, _RIM_LEAST)


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


class CheckAside:
    """Checks of a rig, each in a process of its own, behind whatever else runs.

    SciPy's optimisers take some tenths of a second, much of it in Python: in a thread they would
    hold up the photographs that come meanwhile.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

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
        told, _ = process.communicate(pickle.dumps(given))
        if process.returncode:
            raise CalibrationError(f'its process ended with the status {process.returncode}')
        found = pickle.loads(told)
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
    resource.setrlimit(resource.RLIMIT_CPU, (_LONGEST, _LONGEST))
    found: Check | CalibrationError
    try:
        found = check(*pickle.load(sys.stdin.buffer))
    except CalibrationError as reason:
        found = reason
    pickle.dump(found, sys.stdout.buffer)
