"""The pictures of the calibration's page."""

from __future__ import annotations

import base64
import io

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ftp_dent_ros.calibration.adjustment.solving import Solution
from ftp_dent_ros.calibration.adjustment.uncertainty import depth_deviation
from ftp_dent_ros.rig.rig import Lens

# A usual arrow is so long that it is seen, as a part of the image's width.
_SEEN = 0.015


def residual_maps(solution: Solution) -> str:
    """Residuals of camera and projector over their images, as arrows."""
    figure = Figure(figsize=(10.5, 3.6), layout='constrained')
    for axes, lens, part, name in zip(
        figure.subplots(1, 2),
        (solution.rig.camera, solution.rig.projector),
        (slice(0, 2), slice(2, 4)),
        ('camera', 'projector'),
        strict=True,
    ):
        place = np.concatenate(
            [o.camera if name == 'camera' else o.projector for o in solution.observations]
        )
        off = np.concatenate(solution.estimate.residuals)[:, part]
        known = np.isfinite(off).all(axis=1)
        u, v = place[known].T
        usual = max(float(np.sqrt(np.mean(np.square(off[known])))), 1e-6)
        magnified = 10 ** round(np.log10(_SEEN * lens.width / usual))
        axes.quiver(
            u,
            v,
            *(magnified * off[known]).T,
            angles='xy',
            scale_units='xy',
            scale=1,
            width=0.0015,
            color='#1f5fa8',
        )
        _frame(axes, lens, f'{name}: residuals, {magnified} times as long')
    return _png(figure)


def coverage(solution: Solution) -> str:
    """Where corners were seen and lit, and how far away and how tilted the boards were."""
    figure = Figure(figsize=(10.5, 3.4), layout='constrained')
    camera, projector, places = figure.subplots(1, 3)
    for axes, lens, name in (
        (camera, solution.rig.camera, 'camera'),
        (projector, solution.rig.projector, 'projector'),
    ):
        for observation in solution.observations:
            u, v = getattr(observation, name).T
            axes.plot(u, v, '.', markersize=2)
        _frame(axes, lens, f'{name}: corners, a colour a pose')
    poses = solution.estimate.poses
    tilt = np.degrees(np.arccos(np.clip(_facing(poses), -1, 1)))
    places.plot(1e3 * poses[:, 5], tilt, 'o', color='#1f5fa8')
    places.set(xlabel='distance, mm', ylabel='tilt, degrees', ylim=(0, None))
    places.set_title('boards', fontsize=9)
    places.tick_params(labelsize=8)
    return _png(figure)


def expected_depth(solution: Solution) -> str:
    """Stated standard deviation of the depth over the image, near, amid and far."""
    record, lens = solution.rig.record, solution.rig.camera
    if record is None or record.covariance is None:
        return ''
    u, v = np.meshgrid(np.linspace(0, lens.width - 1, 25), np.linspace(0, lens.height - 1, 17))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    figure = Figure(figsize=(10.5, 3.0), layout='constrained')
    near, far = record.depth_range
    for axes, depth in zip(figure.subplots(1, 3), (near, (near + far) / 2, far), strict=True):
        deviation = 1e3 * depth_deviation(
            solution.rig, record.covariance, pixels, np.full(len(pixels), depth)
        )
        drawn = axes.contourf(u, v, deviation.reshape(u.shape), 12, cmap='viridis')
        bar = figure.colorbar(drawn, ax=axes, shrink=0.85)
        bar.ax.tick_params(labelsize=7)
        _frame(axes, lens, f'at {1e3 * depth:.0f} mm: standard deviation, mm')
    return _png(figure)


def _facing(poses: NDArray) -> NDArray[np.float64]:
    """Cosine of the angle between the board's normal and the line of sight, shape (p,)."""
    from scipy.spatial.transform import Rotation

    normal = Rotation.from_rotvec(poses[:, :3]).apply([0.0, 0.0, 1.0])
    sight = poses[:, 3:] / np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return np.abs((normal * sight).sum(axis=1))


def _frame(axes, lens: Lens, title: str) -> None:
    axes.set(xlim=(0, lens.width), ylim=(lens.height, 0), aspect='equal')
    axes.set_title(title, fontsize=9)
    axes.tick_params(labelsize=7)


def _png(figure: Figure) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format='png', dpi=110)
    return 'data:image/png;base64,' + base64.b64encode(stream.getvalue()).decode()
