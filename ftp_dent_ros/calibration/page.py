"""A calibration as one page that opens offline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.bundle import DISTORTIONS, depth_deviation, rig_vector, rms
from ftp_dent_ros.calibration.solving import Solution
from ftp_dent_ros.files import write_atomically
from ftp_dent_ros.pages.drawing import data_uri, figure_png
from ftp_dent_ros.pages.page import render
from ftp_dent_ros.rig.calibration_record import PARAMETERS
from ftp_dent_ros.rig.rig import Lens

_COEFFICIENTS = ('k1', 'k2', 'p1', 'p2', 'k3')
_LENSES = ('camera', 'projector')
_BLUE = '#1f5fa8'


def residual_maps(solution: Solution) -> Figure:
    """Residuals of camera and projector over their images, as arrows."""
    figure = Figure(figsize=(10.5, 3.6), layout='constrained')
    residuals = np.concatenate(solution.estimate.residuals)
    for axes, name, off in zip(
        figure.subplots(1, 2), _LENSES, np.split(residuals, 2, axis=1), strict=True
    ):
        lens = getattr(solution.rig, name)
        place = np.concatenate([getattr(each, name) for each in solution.estimate.observations])
        usual = max(float(np.sqrt(np.nanmean(np.square(off)))), 1e-6)
        magnified = 10 ** round(np.log10(0.015 * lens.width / usual))
        to_scale = {'angles': 'xy', 'scale_units': 'xy', 'scale': 1}
        axes.quiver(*place.T, *(magnified * off).T, **to_scale, width=0.0015, color=_BLUE)
        _frame(axes, lens, f'{name}: residuals, {magnified} times as long')
    return figure


def coverage(solution: Solution) -> Figure:
    """Where corners were seen and lit, and how far away and how tilted the boards were."""
    figure = Figure(figsize=(10.5, 3.4), layout='constrained')
    *images, places = figure.subplots(1, 3)
    for axes, name in zip(images, _LENSES, strict=True):
        for observation in solution.estimate.observations:
            axes.plot(*getattr(observation, name).T, '.', markersize=2)
        _frame(axes, getattr(solution.rig, name), f'{name}: corners, a colour a pose')
    turns, shifts = np.split(solution.estimate.poses, 2, axis=1)
    normals = Rotation.from_rotvec(turns).apply([0.0, 0.0, 1.0])
    facing = np.abs((normals * shifts).sum(axis=1)) / np.linalg.norm(shifts, axis=1)
    places.plot(1e3 * shifts[:, 2], np.degrees(np.arccos(facing.clip(0, 1))), 'o', color=_BLUE)
    places.set(xlabel='distance, mm', ylabel='tilt, degrees', ylim=(0, None))
    places.set_title('boards', fontsize=9)
    places.tick_params(labelsize=8)
    return figure


def expected_depth(solution: Solution) -> Figure:
    """Stated standard deviation of the depth over the image, near, amid and far."""
    record, lens = solution.rig.record, solution.rig.camera
    assert record is not None and record.covariance is not None
    grid = lens.sample_grid(25, 17)
    pixels = grid.reshape(-1, 2)
    figure = Figure(figsize=(10.5, 3.0), layout='constrained')
    for axes, depth in zip(
        figure.subplots(1, 3), np.linspace(*record.depth_range, 3), strict=True
    ):
        distance = np.full(len(pixels), depth)
        deviation = depth_deviation(solution.rig, record.covariance, pixels, distance)
        over = deviation.reshape(grid.shape[:2])
        drawn = axes.contourf(*np.moveaxis(grid, -1, 0), 1e3 * over, 12, cmap='viridis')
        figure.colorbar(drawn, ax=axes, shrink=0.85).ax.tick_params(labelsize=7)
        _frame(axes, lens, f'at {1e3 * depth:.0f} mm: standard deviation, mm')
    return figure


def _frame(axes: Axes, lens: Lens, title: str) -> None:
    axes.set(xlim=(0, lens.width), ylim=(lens.height, 0), aspect='equal')
    axes.set_title(title, fontsize=9)
    axes.tick_params(labelsize=7)


def write_page(path: Path, solution: Solution, left_out: list[str]) -> None:
    """Write the page of a solution; `left_out` are sentences on poses that were not used."""
    text = render(
        'ftp_dent_ros.calibration',
        'templates/page.html.j2',
        solution=solution,
        numbers=_numbers(solution),
        terms=_terms(solution),
        depth=depth_words(solution),
        poses=_poses(solution),
        excluded=left_out,
        pictures={
            name: data_uri(figure_png(drawn(solution)))
            for name, drawn in (
                ('residuals', residual_maps),
                ('coverage', coverage),
                ('expected', expected_depth),
            )
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


def _numbers(solution: Solution) -> list[tuple[str, str, str]]:
    """Names of the rig's numbers, the numbers, and their standard deviations."""
    values, record = rig_vector(solution.rig), solution.rig.record
    assert record is not None and record.covariance is not None
    length = float(np.linalg.norm(values[21:]))
    along = values[21:] / length
    variances = [*np.diag(record.covariance), 1e6 * along @ record.covariance[21:, 21:] @ along]
    rows = []
    for name, value, variance in zip(
        (*PARAMETERS, 'baseline, mm'), (*values, 1e3 * length), variances, strict=True
    ):
        digits = {'f': 2, 'c': 2, 'b': 3}.get(name.rpartition('.')[2][0], 5)
        deviation = f'{np.sqrt(variance):.{digits}f}' if variance > 0 else 'not estimated'
        rows.append((name, f'{value:.{digits}f}', deviation))
    return rows


def _terms(solution: Solution) -> str:
    model = solution.model
    words = [
        f'{name} {", ".join(_COEFFICIENTS[i] for i in DISTORTIONS[terms]) or "none"}'
        for name, terms in zip(_LENSES, (model.camera, model.projector), strict=True)
    ]
    bend = 1e3 * float(np.abs(solution.estimate.bend).max())
    bent = f'bent (a quadratic, by up to {bend:.2f} mm)'
    return '; '.join([*words, f'the board is {bent if model.bent else "flat"}'])


def _poses(solution: Solution) -> list[tuple[object, ...]]:
    """Name, errors of camera, projector and both, and how many corners are seen and lit."""
    estimate = solution.estimate
    return [
        (
            each.name,
            *(f'{error:.3f}' if np.isfinite(error) else '' for error in rms(residuals)),
            *(int(np.isfinite(at).all(axis=1).sum()) for at in (each.camera, each.projector)),
        )
        for each, residuals in zip(estimate.observations, estimate.residuals, strict=True)
    ]
