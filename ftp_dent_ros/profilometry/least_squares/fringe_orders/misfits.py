"""How badly the steps of the contrast fit an order, place by place."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.code.contrast_code import WORD, ContrastSteps
from ftp_dent_ros.profilometry.least_squares.code.expected_steps import ExpectedSteps


def misfit_in_light(
    steps: ContrastSteps, expected: ExpectedSteps, order: int, scale: float, rows: int
) -> NDArray[np.float32]:
    """Mean square misfit of an order around each step, of contrasts or of amplitudes.

    Light from elsewhere changes a fringe's level and with it the contrast, but no amplitude; paint
    changes the amplitude, but no contrast. So the order fits if either does.

    Parameters
    ----------
    steps, expected, order, scale, rows
        As of `misfit_of`.
    """
    contrast, amplitude = (
        misfit_of(each, expected, order, scale, rows) for each in (steps, steps.of_amplitude)
    )
    return np.minimum(contrast, amplitude)


def misfit_of(
    steps: ContrastSteps, expected: ExpectedSteps, order: int, scale: float, rows: int
) -> NDArray[np.float32]:
    """Mean square misfit of an order around each step.

    Parameters
    ----------
    steps : ContrastSteps
    expected : ExpectedSteps
    order : int
    scale : float
        Of the steps, over those that are expected.
    rows : int
        That are judged together.
    """
    known = steps.weight > 0
    own, before, after = (
        around(steps.misfit(expected, order + more, scale), known, rows) for more in (0, -1, 1)
    )
    # One fringe on, a change of the code looks like an edge in its place.
    edges = steps.misfit_but_for_edges(expected, order, scale)
    sure = own < np.minimum(before, after)
    return np.where(sure, around(edges, known, rows), own)


def around(
    values: NDArray[np.float32], known: NDArray[np.bool_], rows: int
) -> NDArray[np.float32]:
    """Mean of what is known around each step, over a word and so many rows.

    Parameters
    ----------
    values : ndarray, shape (rows, fringes), float32
    known : ndarray, shape (rows, fringes), bool
    rows : int
    """
    weight = known.astype(np.float32)
    total, count = (
        cv2.blur(each, (WORD - 1, rows), borderType=cv2.BORDER_CONSTANT)
        for each in (weight * values, weight)
    )
    mean: Any = total / np.maximum(count, np.float32(1e-3))
    return mean
