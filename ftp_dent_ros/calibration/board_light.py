"""The fringes' light on a calibration board: where it is, how strong, and the board without it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.rig import Rig

# Of the polynomial that projector columns are over the board, and how far beyond its corners it is
# believed, as a part of its sides.
_DEGREE, _AROUND = 4, 0.2
# Part of a square's side within which it is of one colour in spite of blur, and samples a side.
_INNER, _SAMPLES = 0.6, 13


def smoothed(levels: NDArray, rig: Rig, pattern: Pattern) -> NDArray[np.uint8]:
    """The photograph without its fringes: a window of two periods has a zero at theirs."""
    told = 0 if pattern.axis == 'u' else 1
    period = pattern.period_px * (
        rig.camera.camera_matrix[told, told] / rig.projector.camera_matrix[told, told]
    )
    length = 2 * round(period) + 1
    window = np.hanning(length + 2)[1:-1]
    smooth = cv2.sepFilter2D(levels.astype(np.float32), -1, window, window)
    return np.clip(smooth * (230 / max(float(np.percentile(smooth, 99)), 1e-3)), 0, 255).astype(
        np.uint8
    )


def smooth_columns(place: NDArray, columns: NDArray) -> tuple[NDArray, NDArray[np.bool_]]:
    """Coefficients of the columns over the board's unit square, and which points fit them."""
    terms = _terms(place)
    inside = np.ones(len(place), bool)
    for _ in range(3):
        fitted, *_ = np.linalg.lstsq(terms[inside], columns[inside], rcond=None)
        off = np.abs(columns - terms @ fitted)
        inside = off <= 4 * 1.4826 * np.median(off) + 1e-6
    return fitted, inside


def _terms(place: NDArray) -> NDArray[np.float64]:
    x, y = place.T
    return np.polynomial.polynomial.polyvander2d(x, y, [_DEGREE, _DEGREE])


def light(
    board: Board, pattern: Pattern, levels: NDArray, to_board: NDArray, fitted: NDArray
) -> NDArray[np.float32]:
    """Light of the fringes on each pixel of the board, mean 1; 1 elsewhere."""
    v, u = np.indices(levels.shape)
    place = mapped(to_board, np.stack([u.ravel(), v.ravel()], axis=1)) / board.points[-1, :2]
    on = ((place > -_AROUND) & (place < 1 + _AROUND)).all(axis=1)
    wave = np.zeros(levels.size, np.float32)
    wave[on] = 2 * pattern.intensity(_terms(place[on]) @ fitted) - 1
    image: NDArray[np.float32] = wave.reshape(levels.shape)
    contrast = _contrast(board, levels, image, np.linalg.inv(to_board))
    return 1 + np.float32(contrast) * image


def _contrast(board: Board, levels: NDArray, wave: NDArray, to_image: NDArray) -> float:
    """Contrast of the fringes on the board's white squares, 0 to 1."""
    offsets = np.linspace(-_INNER / 2, _INNER / 2, _SAMPLES)
    x, y, dx, dy = np.meshgrid(
        np.arange(board.columns - 1) + 0.5, np.arange(board.rows - 1) + 0.5, offsets, offsets
    )
    at = mapped(to_image, board.square * np.stack([(x + dx).ravel(), (y + dy).ravel()], axis=1))
    seen, lit = (
        map_coordinates(each, at[:, ::-1].T, order=1, mode='nearest').reshape(-1, _SAMPLES**2)
        for each in (levels, wave)
    )
    means = seen.mean(axis=1)
    bright = means >= np.median(means)
    slopes, middles = np.array(
        [np.polyfit(*each, 1) for each in zip(lit[bright], seen[bright], strict=True)]
    ).T
    return float(np.clip(np.median(slopes / np.maximum(middles, 1e-3)), 0, 1))


def mapped(plane: NDArray, at: NDArray) -> NDArray[np.float64]:
    """Points of shape (n, 2) through a homography."""
    ends = np.asarray(at, float) @ plane[:, :2].T + plane[:, 2]
    return ends[:, :2] / ends[:, 2:]
