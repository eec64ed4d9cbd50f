"""What a measured turn of the projector says of a rig, and the rig with it taken out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import norm, t

from ftp_dent_ros.calibration.uncertainty import depth_deviation
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.rig.rig import Rig

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
