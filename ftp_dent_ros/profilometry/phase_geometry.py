"""What the points of a grid see: phase as a function of inverse depth, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.triangulation import meet, turned
from ftp_dent_ros.rig.rig import Lens, Rig

# Between rays that are undistorted one by one, pixels.
_SPACING = 16


def rays_at(lens: Lens, columns: NDArray, rows: NDArray) -> NDArray[np.float32]:
    """Undistorted rays through the crossings of pixel columns and rows, quickly.

    Returns
    -------
    ndarray, shape (rows, columns, 2), float32
        x and y of the rays with z = 1.
    """
    if not lens.distortion.any():
        focal = lens.camera_matrix[[0, 1], [0, 1]]
        x, y = (
            (p - c) / f
            for p, c, f in zip((columns, rows), lens.camera_matrix[:2, 2], focal, strict=True)
        )
        return np.stack(np.meshgrid(x, y), axis=-1).astype(np.float32)
    ends = [
        np.linspace(-_SPACING, size + _SPACING, size // _SPACING + 4)
        for size in (lens.width, lens.height)
    ]
    exact = lens.rays(np.stack(np.meshgrid(*ends), axis=-1))[..., :2]
    # Weights of the rays between which cubic splines interpolate.
    along_u, along_v = (
        make_interp_spline(e, np.eye(len(e)))(p)
        for p, e in zip((columns, rows), ends, strict=True)
    )
    return np.stack([along_v @ (along_u @ exact[..., i].T).T for i in range(2)], axis=-1).astype(
        np.float32
    )


@dataclass(frozen=True, eq=False)
class PhaseGeometry:
    """Rays of a grid, and what the projector shows where they end.

    Attributes
    ----------
    rig : Rig
    pattern : Pattern
    rays : ndarray, shape (rows, columns, 2), float32
        x and y of the undistorted rays with z = 1.
    along : list of ndarray, shape (rows, columns), float32
        The rays in the projector's frame.
    """

    rig: Rig
    pattern: Pattern
    rays: NDArray[np.float32]
    along: list[NDArray[np.float32]]

    @classmethod
    def of(
        cls,
        rig: Rig,
        pattern: Pattern,
        columns: NDArray[np.floating],
        rows: NDArray[np.floating],
    ) -> PhaseGeometry:
        """PhaseGeometry at the crossings of pixel columns and rows."""
        rays = rays_at(rig.camera, columns, rows)
        return cls(rig, pattern, rays, turned(rig, rays))

    def phase(self, inverse_depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Absolute phase at points of inverse depth 1 / z, radians (eq. 2)."""
        lens = self.rig.projector
        t_x, t_y, t_z = self.rig.translation.astype(np.float32)
        scale = 1 / (self.along[2] + t_z * inverse_depth)
        x = (self.along[0] + t_x * inverse_depth) * scale
        if lens.distortion.any():
            y = (self.along[1] + t_y * inverse_depth) * scale
            k1, k2, p1, p2, k3 = lens.distortion.astype(np.float32)
            r2 = x * x + y * y
            x = x * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        turn = 2 * np.pi / self.pattern.period_px
        x *= np.float32(turn * lens.camera_matrix[0, 0])
        x += np.float32(turn * (lens.camera_matrix[0, 2] - self.pattern.stripe_center_px))
        return x

    def meet(self, phase: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Inverse depth and projector row v_p at points of absolute phase."""
        turn = np.float32(self.pattern.period_px / (2 * np.pi))
        columns = turn * phase + np.float32(self.pattern.stripe_center_px)
        depth, v_p = meet(self.rig, self.along, columns)
        return np.float32(1) / depth, v_p

    def per_radian(self, phase: NDArray[np.float32]) -> NDArray[np.float32]:
        """What points move along their rays with the phase, metres; zero where there are none."""
        (near, _), (far, _) = (self.meet(phase + np.float32(half)) for half in (-0.5, 0.5))
        x, y = self.rays[..., 0], self.rays[..., 1]
        length = np.sqrt(1 + x * x + y * y)
        moved: NDArray[np.float32] = np.abs(1 / far - 1 / near) * length
        return np.nan_to_num(moved)

    def within_panel(self, phase: NDArray[np.float32]) -> NDArray[np.float32]:
        """Projector pixels from the panel's nearest rim at a phase, less than 0 beyond it."""
        (_, v_p), panel = self.meet(phase), self.rig.projector
        u_p = self.pattern.column(phase).astype(np.float32)
        across = np.minimum(u_p, panel.width - 1 - u_p)
        return np.minimum(across, np.minimum(v_p, panel.height - 1 - v_p)) + np.float32(0.5)
