"""Photographs that this project did not make: real ones, and another renderer's, with their truth.

They stand in a folder beside the project, `../shared`, and are passed over where they are not:
`real/lion` with z at every pixel, `real/desk` with the projector's column, `eval/scenes/*` with z,
what is lit at every second pixel, and dents. `real/calibration` shows a board in white light and
in none: fringes are drawn between the two, where the calibrated rig and the board have them. So
the paint, the lens, the camera's black level and its noise are real.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
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
from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.bundle import Model
from ftp_dent_ros.calibration.sequence import Sequence
from ftp_dent_ros.calibration.session import Session, see_poses
from ftp_dent_ros.calibration.solving import Solution, solve
from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pattern.pattern import CODES, Pattern
from ftp_dent_ros.photograph.file import read_photograph
from ftp_dent_ros.rig.rig import Rig, read_rig
from ftp_dent_ros.simulation.truth import TrueDent

SHARED = Path(__file__).resolve().parents[2] / 'shared'
METHODS: dict[str, dict[str, Any]] = {'default': {}, PAPERS_METHOD: {'method': PAPERS_METHOD}}
# Of `real/desk`: what its truth tells apart.
REGIONS = {'smooth': 1, 'object': 2}
# Of the board in `real/calibration`: its squares, and the projector; fringes in its pixels, of
# which the camera sees one 1.8 wide; and the blur of a projector, in these.
_BOARD, _PROJECTOR = Board(7, 9, 0.075), (1024, 768)
PERIODS = 5.0, 9.0, 18.0, 36.0
_BLUR_PX = 0.6


def names() -> list[str]:
    """All photographs that are there."""
    real = (*SHARED.glob('real/lion/image*.png'), *SHARED.glob('real/desk/image*.png'))
    rendered = SHARED.glob('eval/scenes/*/image.png')
    boards = sorted(SHARED.glob('real/calibration/pose_*'))
    return [
        *sorted(str(path.relative_to(SHARED)) for path in (*real, *rendered)),
        *(f'{each.relative_to(SHARED)}, {px:g} px' for px in PERIODS for each in boards),
    ]


def given(name: str, seed: int, draw: int) -> dict[str, Figures]:
    """A photograph by each method; of the desk, each region; of a board, each code."""
    image = SHARED / name
    if image.parent.name == 'calibration':
        pose, _, period = name.partition(', ')
        return _on_board(SHARED / pose, float(period.split()[0]))
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
    for region, number in REGIONS.items():
        figures = rows[f'{method}, {region}']
        with attempt(figures):
            found = _reconstructed(image, 1, settings)
            figures |= _in_projector(*found, truth['region'] == number, column, doubt)
    return rows


def _in_projector(
    cloud: Cloud,
    rig: Rig,
    pattern: Pattern,
    there: NDArray[np.bool_],
    column: NDArray[np.float64],
    doubt: NDArray[np.float64],
) -> Figures:
    """Errors of points in the projector's pixels, across the fringes."""
    on = there & cloud.valid
    figures: Figures = {'coverage': float(on.sum() / there.sum())}
    points = cloud.points[on].astype(float)
    seen = _column(rig, pattern, points)
    error = np.abs(seen - column[on])
    if len(error):
        figures['mae_px'] = float(error.mean())
        figures['p95_px'] = float(np.percentile(error, 95))
        figures['wrong_order'] = float((error > pattern.period_px / 2).mean())
    away = points * (1 + cloud.sigma[on] / np.linalg.norm(points, axis=1))[:, None]
    sigma = np.hypot(doubt[on], _column(rig, pattern, away) - seen)
    ratio = root_mean_square((error / sigma)[error < pattern.period_px / 2])
    if not math.isnan(ratio):
        figures['error_over_sigma'] = ratio
    return figures


@cache
def _calibrated() -> Solution:
    """The rig and the boards of `real/calibration`."""
    folder, sequence = SHARED / 'real' / 'calibration', Sequence(*_PROJECTOR, period=0)
    sights, _, size = see_poses(folder, Session(_BOARD, sequence))
    seen = [sight.observation for sight in sights]
    return solve(seen, _BOARD, size, _PROJECTOR, model=Model(3, 3, bent=True))


@dataclass(frozen=True, eq=False)
class _LitBoard:
    """A real board, and where the projector lights it.

    Attributes
    ----------
    black, white : ndarray, shape (rows, columns), float32
        Photographs in no light, and in white light.
    place : ndarray, shape (rows, columns, 2), float32
        Projector pixels that light the board's plane.
    there : ndarray of bool, shape (rows, columns)
        Where the board is.
    """

    black: NDArray[np.float32]
    white: NDArray[np.float32]
    place: NDArray[np.float32]
    there: NDArray[np.bool_]

    @classmethod
    def of(cls, pose: Path) -> _LitBoard:
        """The board in the folder of a pose."""
        photographs = [_grey(pose / f'graycode_{number}.png') for number in (40, 41)]
        black, white = sorted(photographs, key=np.mean)
        names = [each.name for each in _calibrated().estimate.observations]
        corners = _calibrated().estimate.points()[names.index(pose.name)]
        middle = corners.mean(axis=0)
        normal = np.linalg.svd(corners - middle)[2][2]
        rig = _calibrated().rig
        rays = rig.camera.rays(rig.camera.pixel_grid(1))
        plane = rays * (normal @ middle / (rays @ normal))[..., None]
        place = rig.projector.project(rig.to_projector(plane)).astype(np.float32)
        # The corners, and the squares around them.
        seen = rig.camera.project(corners).astype(np.float32)
        board: Any = np.zeros(black.shape, np.uint8)
        cv2.fillConvexPoly(board, np.rint(cv2.convexHull(seen)).astype(np.int32), 1)
        square = int(np.median(np.linalg.norm(np.diff(seen, axis=0), axis=1)))
        there = cv2.dilate(board, np.ones((square, square), np.uint8)) > 0
        # The photographs are black around the board's surroundings.
        return cls(black, white, place, there & (cv2.erode(white, np.ones((5, 5))) > 0))

    def in_fringes(self, pattern: Pattern) -> NDArray[np.uint8]:
        """Photograph of the board in a pattern."""
        drawn = cv2.GaussianBlur(pattern.draw().astype(np.float32) / 255, (0, 0), _BLUR_PX)
        share = cv2.remap(drawn, self.place[..., 0], self.place[..., 1], cv2.INTER_CUBIC)
        light = self.black[..., None] + (self.white - self.black)[..., None] * share
        light[self.white == 0] = np.median(self.black[self.there])
        return np.clip(np.rint(light), 0, 255).astype(np.uint8)


def _grey(path: Path) -> NDArray[np.float32]:
    image: Any = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    return image.astype(np.float32)


def _on_board(pose: Path, period: float) -> dict[str, Figures]:
    """Errors of a board in fringes, in the projector's rows: its baseline is upright."""
    rows: dict[str, Figures] = {}
    board, rig = _LitBoard.of(pose), _calibrated().rig
    row = board.place[..., 1].astype(float)
    middle = float(np.median(row[board.there]))
    for method, settings in METHODS.items():
        for code in CODES if not settings else ('stripe',):
            pattern = Pattern(*_PROJECTOR, period, middle, 'v', code=code)
            figures = rows.setdefault(f'{method}, {code}', {})
            with attempt(figures):
                cloud = reconstruct(board.in_fringes(pattern), rig, pattern, **settings).cloud
                known = board.there, row, np.zeros(row.shape)
                figures |= _in_projector(cloud, rig, pattern, *known)
    return rows


def _column(rig: Rig, pattern: Pattern, points: NDArray[np.float64]) -> NDArray[np.float64]:
    axis = 'uv'.index(pattern.axis)
    return rig.projector.project(rig.to_projector(points))[..., axis]
