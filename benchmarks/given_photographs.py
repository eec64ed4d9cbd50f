"""Photographs that this project did not make: real ones, and another renderer's, with their truth.

They stand in a folder beside the project, `../shared`, and are passed over where they are not:
`real/lion` with z at every pixel, `real/desk` with the projector's column, `eval/scenes/*` with z,
what is lit at every second pixel, and dents.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from measures import (
    MM,
    PAPERS_METHOD,
    Figures,
    attempt,
    fringe_depth,
    of_dents,
    of_points,
    pixel_of,
    root_mean_square,
)
from numpy.typing import NDArray

from ftp_dent_ros import inspect, reconstruct
from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.file import read_photograph
from ftp_dent_ros.rig.rig import Rig, read_rig
from ftp_dent_ros.simulation.truth import TrueDent

SHARED = Path(__file__).resolve().parents[2] / 'shared'
METHODS: dict[str, dict[str, Any]] = {'default': {}, PAPERS_METHOD: {'method': PAPERS_METHOD}}
# Of `real/desk`: what its truth tells apart.
REGIONS = {'smooth': 1, 'object': 2}


def names() -> list[str]:
    """All photographs that are there."""
    real = (*SHARED.glob('real/lion/image*.png'), *SHARED.glob('real/desk/image*.png'))
    rendered = SHARED.glob('eval/scenes/*/image.png')
    return sorted(str(path.relative_to(SHARED)) for path in (*real, *rendered))


def given(name: str, seed: int, draw: int) -> dict[str, Figures]:
    """A photograph by each method; of the desk, each region by each method."""
    image = SHARED / name
    rows: dict[str, Figures] = {}
    for method, settings in METHODS.items():
        if image.parent.name == 'desk':
            rows |= _on_desk(image, method, settings)
        else:
            measure = _on_lion if image.parent.name == 'lion' else _rendered
            rows[method] = measure(image, settings)
    return rows


def _reconstructed(
    image: Path, stride: int, settings: dict[str, Any]
) -> tuple[Cloud, Rig, Pattern]:
    rig = read_rig(image.with_name('rig.yaml'))
    file = image.with_name(image.name.replace('image', 'pattern')).with_suffix('.yaml')
    pattern = read_pattern(file)
    measured = reconstruct(read_photograph(image), rig, pattern, stride=stride, **settings)
    return measured.cloud, rig, pattern


def _on_lion(image: Path, settings: dict[str, Any]) -> Figures:
    figures: Figures = {}
    depth = np.load(image.with_name('truth.npz'))['z'].astype(float)
    with attempt(figures):
        cloud, rig, pattern = _reconstructed(image, 1, settings)
        fringe = fringe_depth(rig, pattern, depth)
        figures |= of_points(cloud, cloud.points[..., 2] - depth, np.isfinite(depth), fringe)
    return figures


def _rendered(image: Path, settings: dict[str, Any]) -> Figures:
    figures: Figures = {}
    truth = np.load(image.with_name('gt_depth.npz'))
    depth, lit, step = truth['z'].astype(float), truth['valid'], int(truth['step'])
    with attempt(figures):
        cloud, rig, pattern = _reconstructed(image, step, settings)
        along = np.linalg.norm(rig.camera.rays(rig.camera.pixel_grid(step)), axis=-1)
        fringe = fringe_depth(rig, pattern, depth)
        figures |= of_points(cloud, (cloud.points[..., 2] - depth) * along, lit, fringe)
        if not settings:
            told = json.loads(image.with_name('scene.json').read_text())['dents']
            pixels = {dent: pixel_of(rig, step, dent) for dent in map(_true_dent, told)}
            shown = {dent: at for dent, at in pixels.items() if _in_view(lit, *at)}
            figures |= of_dents(inspect(cloud), list(shown), list(shown.values()))
    return figures


def _true_dent(told: dict[str, Any]) -> TrueDent:
    place, normal = np.array([told[axis] for axis in 'xyz']), np.array(told['normal'])
    depth, length, width = (told[k] / MM for k in ('depth_mm', 'length10_mm', 'width10_mm'))
    nowhere = np.empty((0, 3))
    return TrueDent('dent', place, normal, normal, depth, length, width, nowhere, nowhere)


def _in_view(lit: NDArray[np.bool_], row: int, column: int) -> bool:
    rows, columns = lit.shape
    return 0 <= row < rows and 0 <= column < columns and bool(lit[row, column])


def _on_desk(image: Path, method: str, settings: dict[str, Any]) -> dict[str, Figures]:
    """Errors in columns of the projector, so that the rig, which is guessed, cancels."""
    rows: dict[str, Figures] = {f'{method}, {region}': {} for region in REGIONS}
    truth = np.load(image.with_name('truth.npz'))
    column, doubt = (truth[name].astype(float) for name in ('u_p', 'sigma'))
    period = read_pattern(image.with_name('pattern.yaml')).period_px
    for region, number in REGIONS.items():
        figures = rows[f'{method}, {region}']
        with attempt(figures):
            cloud, rig, _ = _reconstructed(image, 1, settings)
            there = truth['region'] == number
            on = there & cloud.valid
            figures['coverage'] = float(on.sum() / there.sum())
            points = cloud.points[on].astype(float)
            seen = _column(rig, points)
            error = np.abs(seen - column[on])
            if len(error):
                figures['mae_px'] = float(error.mean())
                figures['p95_px'] = float(np.percentile(error, 95))
                figures['wrong_order'] = float((error > period / 2).mean())
            away = points * (1 + cloud.sigma[on] / np.linalg.norm(points, axis=1))[:, None]
            sigma = np.hypot(doubt[on], _column(rig, away) - seen)
            right = error < period / 2
            ratio = root_mean_square((error / sigma)[right])
            if not math.isnan(ratio):
                figures['error_over_sigma'] = ratio
    return rows


def _column(rig: Rig, points: NDArray[np.float64]) -> NDArray[np.float64]:
    return rig.projector.project(rig.to_projector(points))[..., 0]
