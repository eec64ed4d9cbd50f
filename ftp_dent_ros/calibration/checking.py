"""Whether a rig still holds, from one photograph of a flat wall or a smooth skin in its pattern.

Fringes along one axis give three equations for three unknowns, so a wrong rig gives a cloud all
the same. Two things betray it: the rim of the projector's frame, whose rows are known, and that a
wall is flat. The projector's turn against the camera is estimated from both, with the wall's place
and, for a skin, its curvature as unknowns. A shift of all columns alike leaves a wall flat (planes
stay planes in projective geometry) and only moves it: a board shows that too, see `board_check`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.rim import find_rim, inverse_depth
from ftp_dent_ros.calibration.uncertainty import depth_deviation
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.photograph import Photograph
from ftp_dent_ros.rig import Rig

# A fitted quadratic follows a wall or a skin to this, if it is not known to be flatter; metres.
_SMOOTH = 5e-5
# What is known of a rim: its blur is even to this part of a pixel, and so are phases.
_RIM_PX, PHASE_PX = 0.15, 0.03
# Neighbours err together: as if there were a tenth as many (its square).
ALIKE = np.sqrt(10)
MOST_POINTS = 1500
# A turn counts as drift beyond so many deviations, and this many projector pixels.
_SURE, _DRIFT_PX = 4.0, 0.4
# Corners of a board, through fringes, fit a lens that holds to a tenth of a pixel; RMS, pixels.
_CAMERA_PX = 0.25
# Worse known than this it is not known, projector pixels.
_UNKNOWN_PX = 1.2
AXES = ('pitch', 'yaw', 'roll')


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
        return self.camera_px is None or self.camera_px <= _CAMERA_PX

    @property
    def holds(self) -> bool:
        """Whether nothing moved that was seen."""
        return self.camera_holds and not self.moved

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
        blind = list(self.unknown)
        if self.camera_px is None:
            blind.append('a shift across the fringes, which a board shows')
        said = 'the rig holds, as far as this photograph tells'
        return f'{said}; it tells nothing of {", ".join(blind)}' if blind else said


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
        the yaw shows in nothing else. Infinite for a skin, of which nothing is known but that it
        curves evenly.

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
    seen = seen[:: max(1, len(seen) // MOST_POINTS)]
    rays = seen / seen[:, 2:]
    # Of the two projector coordinates the fringes tell one, and their ends the other.
    told, other = (0, 1) if pattern.axis == 'u' else (1, 0)
    columns = rig.projector.project(rig.to_projector(seen))[:, told]
    distance = float(np.median(seen[:, 2]))
    shape, *_ = np.linalg.lstsq(inverse_depth(rays), 1 / seen[:, 2], rcond=None)
    rim_pixels, rows = find_rim(rig, pattern, fringe_levels(image), shape)
    rim_rays = rig.camera.rays(rim_pixels) if len(rim_pixels) else np.zeros((0, 3))
    scale = rig.projector.camera_matrix[told, told] * np.linalg.norm(rig.translation)
    phase_noise = np.hypot(PHASE_PX, min(_SMOOTH, flatness) * scale / distance**2)
    reach = float(np.percentile(np.hypot(rays[:, 0], rays[:, 1]), 95))
    bend = flatness / distance**2 / reach**2

    def residuals(state: NDArray) -> NDArray[np.float64]:
        by = turned(rig, state[:3])
        parts = []
        for each, axis, known, noise in (
            (rays, told, columns, phase_noise),
            (rim_rays, other, rows, _RIM_PX),
        ):
            inverse = inverse_depth(each) @ state[3:]
            pixel = by.projector.project(by.to_projector(each / inverse[:, None]))
            parts.append((pixel[:, axis] - known) / (noise * ALIKE))
        return np.concatenate([*parts, state[6:] / bend])

    start = np.concatenate([np.zeros(3), shape])
    found = least_squares(residuals, start, x_scale='jac', loss='soft_l1', f_scale=2.0)
    middle = np.median(seen, axis=0)
    return judged(rig, pattern, found.x[:3], turn_covariance(found.jac), middle, len(rows))


def judged(
    rig: Rig,
    pattern: Pattern,
    turn: NDArray,
    covariance: NDArray,
    middle: NDArray,
    rim_points: int = 0,
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
    """
    if rig.record is not None and rig.record.covariance is not None:
        covariance = covariance + rig.record.covariance[18:21, 18:21]
    deviation = np.sqrt(np.diag(covariance))
    lens = rig.projector
    lever = np.array([*lens.camera_matrix[[1, 0], [1, 0]], np.hypot(lens.width, lens.height) / 2])
    drift, doubt = turn * lever, deviation * lever
    unknown = tuple(a for a, each in zip(AXES, doubt, strict=True) if each > _UNKNOWN_PX)
    moved = tuple(
        axis
        for axis, each, spread in zip(AXES, np.abs(drift), doubt, strict=True)
        if axis not in unknown and each > max(_DRIFT_PX, _SURE * spread)
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


def fringe_levels(image: Photograph | NDArray) -> NDArray[np.float64]:
    """Grey levels, shape (height, width), of the colour that all fringes have: red."""
    photograph = Photograph.of(image)
    return photograph.rgb()[..., 0].astype(float) * photograph.unit
