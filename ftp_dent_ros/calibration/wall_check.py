"""Whether a rig still holds, from one photograph of a flat wall or a smooth skin.

Fringes along one axis give three equations for three unknowns, so a wrong rig gives a cloud all
the same. Two things betray it: the rim of the projector's frame, whose rows are known, and that a
wall is flat. The projector's turn against the camera is estimated from both, with the wall's place
as an unknown; from the rim alone on a skin, whose form the fringes tell. A shift of all columns
alike leaves a wall flat (planes stay planes in projective geometry) and only moves it: a board
shows that too, see `board_check`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import norm, t

from ftp_dent_ros.calibration.bundle import depth_deviation
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

# Worse known than this it is not known, projector pixels.
_UNKNOWN_PX = 1.2
AXES = ('pitch', 'yaw', 'roll')

# Fewer places than this are no rim.
_FEWEST = 12
# Half the length of a profile across the rim, camera pixels.
_REACH = 14
# A place so many projector pixels inside the rim tells which way is inward.
_INWARD = 8.0

# Fringes are known to this at first and at best, projector pixels.
PHASE_PX, PHASE_LEAST = 0.03, 0.003
# A residual beyond so many standard deviations is another thing's edge: 1 of 16,000 of noise is.
_FAR = 4.0
# Neighbours err together: as if there were a tenth as many (its square).
_ALIKE = np.sqrt(10)
# No projector has turned by more, radians: what tells nothing leaves this open.
ANY_TURN = 0.1
# Rounds of the search for a ray's depth, and its relative step.
_NEWTON, _STEP = 4, 1e-4


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
            rig, off, middle = rig.transposed, off[[1, 0, 2]], middle[[1, 0, 2]]
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


def turn_covariance(jacobian: NDArray) -> NDArray[np.float64]:
    """Covariance of the first three parameters of weighted residuals, shape (3, 3)."""
    normal = jacobian.T @ jacobian
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True)
    return (inverse * np.outer(scale, scale))[:3, :3]


@dataclass(frozen=True, eq=False)
class Rim:
    """Places on the rims of the frame.

    Attributes
    ----------
    pixels : ndarray, shape (n, 2)
        Of the camera: where the light is half of what it is inside.
    rows : ndarray, shape (n,)
        Projector rows of these rims; columns for fringes of the axis v.
    blur : ndarray, shape (n,)
        Standard deviation of the edge's blur, projector rows, positive if the frame is below.
    """

    pixels: NDArray[np.float64]
    rows: NDArray[np.float64]
    blur: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.rows)

    def sides(self) -> list[NDArray[np.bool_]]:
        """Which places belong to each of the rims seen."""
        return [self.rows == row for row in np.unique(self.rows)]


NO_RIM = Rim(np.zeros((0, 2)), np.zeros(0), np.zeros(0))


def inverse_depth(rays: NDArray) -> NDArray[np.float64]:
    """Terms of the inverse depth along rays: three of a plane, three of its bend."""
    x, y = rays[:, 0], rays[:, 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def find_rim(rig: Rig, pattern: Pattern, levels: NDArray, shape: NDArray) -> Rim:
    """Places on the two rims of the frame at which the fringes end.

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
    upright = pattern.axis == 'u'
    across_fringes, along_fringes = rig.projector.width, rig.projector.height
    if not upright:
        across_fringes, along_fringes = along_fringes, across_fringes
    bright = np.arange(
        pattern.stripe_center_px % pattern.period_px, across_fringes, pattern.period_px
    )
    # Once for all profiles: SciPy would filter the whole photograph for each.
    cubic = spline_filter(levels)
    pixels, rows, blurs = [], [], []
    for row, inward in ((-0.5, 1.0), (along_fringes - 0.5, -1.0)):
        edge = np.column_stack([bright, np.full(len(bright), row)])
        places = [edge + np.array([0, inward * step]) for step in (0.0, _INWARD)]
        ends = [_lit(rig, each if upright else each[:, ::-1], shape) for each in places]
        across = ends[1] - ends[0]
        length = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
        across /= length[:, None]
        offsets = np.arange(-_REACH, _REACH + 0.25, 0.25)
        profile_at = ends[0][:, None] + offsets[:, None] * across[:, None]
        limits = np.array([rig.camera.width - 1, rig.camera.height - 1])
        inside = ((profile_at > 0) & (profile_at < limits)).all(axis=(1, 2))
        for place, way, per_pixel, where in zip(
            ends[0][inside],
            across[inside],
            inward * _INWARD / length[inside],
            profile_at[inside],
            strict=True,
        ):
            profile = map_coordinates(
                cubic, where[:, ::-1].T, output=levels.dtype, prefilter=False
            )
            offset, blur = _step(profile, offsets)
            if np.isfinite(offset):
                pixels.append(place + offset * way)
                rows.append(row)
                blurs.append(blur * per_pixel)
    if len(rows) < _FEWEST:
        return NO_RIM
    return Rim(np.array(pixels), np.array(rows), np.array(blurs))


def _step(profile: NDArray, offsets: NDArray) -> tuple[float, float]:
    """Where a profile is half dark, half light, and its blur's deviation; NaN without an edge."""
    dark, light = np.median(profile[:16]), np.median(profile[-24:])
    # From the dark around the frame to the light in it, at least, grey levels.
    if light - dark < 8.0 or light > 250:
        return np.nan, np.nan
    share = (profile - dark) / (light - dark)
    above = share > 0.5
    crossings = np.flatnonzero(~above[:-1] & above[1:])
    if len(crossings) != 1:
        return np.nan, np.nan
    index = crossings[0]
    first = index - int(np.argmax(share[index::-1] <= 0.25))
    last = index + 1 + int(np.argmax(share[index + 1 :] >= 0.75))
    before = np.interp(0.25, share[first : first + 2], offsets[first : first + 2])
    behind = np.interp(0.75, share[last - 1 : last + 1], offsets[last - 1 : last + 1])
    middle = np.interp(0.5, share[index : index + 2], offsets[index : index + 2])
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
    # Of the two projector coordinates the fringes tell one, and their ends the other.
    told = 0 if pattern.axis == 'u' else 1
    shape, *_ = np.linalg.lstsq(inverse_depth(seen / seen[:, 2:]), 1 / seen[:, 2], rcond=None)
    rim = find_rim(rig, pattern, fringe_levels(image, rig), shape)
    flat = np.isfinite(flatness)
    surface = _wall(rig, told, seen, shape, rim, flatness) if flat else _skin(rig, told, seen, rim)
    # A rim's places are known to this at best, projector rows, and at first.
    rim_noise = np.full(len(rim), 0.15)

    def off_rim(state: NDArray) -> NDArray[np.float64]:
        by = turned(rig, state[:3])
        points = surface.at_rim(by, state[4:])
        row = by.projector.project(by.to_projector(points))[:, 1 - told]
        return row - rim.rows - state[3] * rim.blur

    def residuals(state: NDArray) -> NDArray[np.float64]:
        rest = surface.misfit(turned(rig, state[:3]), state[4:])
        # Half of the levels is half of the light to this part of the blur: for a camera whose
        # exponent is known to 10 % (0.35 of it over the edge's slope, 0.4).
        known = np.append(state[:3] / ANY_TURN, state[3] / 0.09)
        return np.concatenate([rest, off_rim(state) / rim_noise, known])

    start = np.concatenate([np.zeros(4), surface.start])
    for _ in range(3):
        found = least_squares(residuals, start, x_scale='jac', loss='soft_l1', f_scale=2.0)
        start, off = found.x, off_rim(found.x)
        for side in rim.sides():
            rim_noise[side] = scatter(off[side], 0.01)
    middle = np.median(seen, axis=0)
    # Numbers that the places of the rims tell beside their own noise: three turns, the response.
    freedom = max(1, len(rim) - 4) if len(rim) else None
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
    seen = seen[:: max(1, len(seen) // 1500)]
    rays, rim_rays = seen / seen[:, 2:], _rays(rig, rim)
    columns = rig.projector.project(rig.to_projector(seen))[:, told]
    distance = float(np.median(seen[:, 2]))
    scale = rig.projector.camera_matrix[told, told] * np.linalg.norm(rig.translation)
    # A fitted quadratic follows a wall to this, if it is not known to be flatter; metres.
    noise = _ALIKE * np.hypot(PHASE_PX, min(5e-5, flatness) * scale / distance**2)
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
        # Points of a skin that tell the column at a place of the rim near them.
        _, index = cKDTree(pixels).query(rim.pixels, k=40)
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
