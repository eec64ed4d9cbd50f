"""A calibration as one page that opens offline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.bundle import DISTORTIONS, depth_deviation, rig_vector, rms
from ftp_dent_ros.calibration.solving import Solution
from ftp_dent_ros.files import write_atomically
from ftp_dent_ros.pages.drawing import data_uri, figure_png
from ftp_dent_ros.pages.page import render
from ftp_dent_ros.rig.calibration_record import PARAMETERS
from ftp_dent_ros.rig.rig import Lens

_COEFFICIENTS = ('k1', 'k2', 'p1', 'p2', 'k3')


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
        off = solution.estimate.residuals.reshape(-1, 4)[:, part]
        known = np.isfinite(off).all(axis=1)
        u, v = place[known].T
        usual = max(float(np.sqrt(np.mean(np.square(off[known])))), 1e-6)
        magnified = 10 ** round(np.log10(0.015 * lens.width / usual))
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
    return data_uri(figure_png(figure))


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
    return data_uri(figure_png(figure))


def expected_depth(solution: Solution) -> str:
    """Stated standard deviation of the depth over the image, near, amid and far."""
    record, lens = solution.rig.record, solution.rig.camera
    assert record is not None and record.covariance is not None
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
    return data_uri(figure_png(figure))


def _facing(poses: NDArray) -> NDArray[np.float64]:
    """Cosine of the angle between the board's normal and the line of sight, shape (p,)."""
    normal = Rotation.from_rotvec(poses[:, :3]).apply([0.0, 0.0, 1.0])
    sight = poses[:, 3:] / np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return np.abs((normal * sight).sum(axis=1))


def _frame(axes, lens: Lens, title: str) -> None:
    axes.set(xlim=(0, lens.width), ylim=(lens.height, 0), aspect='equal')
    axes.set_title(title, fontsize=9)
    axes.tick_params(labelsize=7)


def write_page(path: Path, solution: Solution, left_out: list[str]) -> None:
    """Write the page of a solution; `left_out` are sentences on poses that were not used."""
    text = render(
        'ftp_dent_ros.calibration',
        'templates/page.html.j2',
        rig=solution.rig,
        record=solution.rig.record,
        remarks=solution.remarks,
        errors=_errors(solution),
        numbers=_numbers(solution),
        terms=_terms(solution),
        depth=depth_words(solution),
        poses=_poses(solution),
        excluded=left_out,
        pictures={
            'residuals': residual_maps(solution),
            'coverage': coverage(solution),
            'expected': expected_depth(solution),
        },
    )
    with write_atomically(path) as temporary:
        temporary.write_text(text, encoding='utf-8', errors='backslashreplace')


def depth_words(solution: Solution) -> str:
    """What the held-out poses say of depths, beside what the covariance states."""
    checked = solution.held_out
    if checked is None:
        return 'Too few poses to hold any out.'
    error = 1e3 * checked.depth_errors
    return (
        f'Corners of held-out poses, triangulated from their columns alone as in flight, lie '
        f'{np.sqrt(np.mean(error**2)):.3f} mm (RMS) off their board, {np.mean(error):+.3f} mm in '
        f'the mean, at {1e3 * checked.depths.min():.0f} to {1e3 * checked.depths.max():.0f} mm; '
        "this has the corners' own noise in it."
    )


def _errors(solution: Solution) -> list[tuple[str, list[str]]]:
    rows = [('all poses', [f'{value:.3f}' for value in solution.estimate.rms()])]
    checked = solution.held_out
    if checked is not None:
        rows.append(('held out', [f'{value:.3f}' for value in checked.rms]))
        rows.append(('predicted', ['', '', f'{checked.stereo_rms:.3f}']))
    return rows


def _numbers(solution: Solution) -> list[list[str]]:
    values, record = rig_vector(solution.rig), solution.rig.record
    assert record is not None and record.covariance is not None
    rows = []
    for name, value, square in zip(PARAMETERS, values, np.diag(record.covariance), strict=True):
        digits = 2 if name[-3:] in ('f_x', 'f_y', 'c_x', 'c_y') else 5
        deviation = f'{np.sqrt(square):.{digits}f}' if square > 0 else 'not estimated'
        rows.append([name, f'{value:.{digits}f}', deviation])
    length = float(np.linalg.norm(values[21:]))
    along = values[21:] / length
    deviation = f'{1e3 * np.sqrt(along @ record.covariance[21:, 21:] @ along):.3f}'
    return [*rows, ['baseline, mm', f'{1e3 * length:.3f}', deviation]]


def _terms(solution: Solution) -> str:
    words = []
    for name, index in (
        ('camera', solution.model.camera),
        ('projector', solution.model.projector),
    ):
        names = ', '.join(_COEFFICIENTS[i] for i in DISTORTIONS[index]) or 'none'
        words.append(f'{name} {names}')
    bend = 1e3 * float(np.abs(solution.estimate.bend).max())
    bent = f'bent (a quadratic, by up to {bend:.2f} mm)'
    words.append(f'the board is {bent if solution.model.bent else "flat"}')
    return '; '.join(words)


def _poses(solution: Solution) -> list[list[str]]:
    rows = []
    for observation, residuals in zip(
        solution.observations, solution.estimate.residuals, strict=True
    ):
        camera, projector, both = rms(residuals)
        seen, lit = (
            int(np.isfinite(each).all(axis=1).sum())
            for each in (observation.camera, observation.projector)
        )
        rows.append(
            [
                observation.name,
                *(
                    f'{value:.3f}' if np.isfinite(value) else ''
                    for value in (camera, projector, both)
                ),
                str(seen),
                str(lit),
            ]
        )
    return rows
