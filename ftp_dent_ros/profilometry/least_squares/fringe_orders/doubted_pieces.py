"""Pieces of a surface that no order fits well: whether they are of the order around them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.code.contrast_code import ContrastSteps
from ftp_dent_ros.profilometry.least_squares.code.expected_steps import ExpectedSteps
from ftp_dent_ros.profilometry.least_squares.fringe_orders.misfits import around

# Times what the better quarter of the places leaves, and times what the best twentieth leaves less
# than that, beyond it, that is another order's: 3.7 standard deviations above the middle.
_NOISE, SCATTER = 2.0, 4.5
# Share of a piece's steps that misfit by no more than noise that is usual: their middle does.
_HALF = 0.5
# Least misfit that is divided by, square steps of the code.
_FAINT = 1e-6


def most_of(values: NDArray[np.float32], scatter: float) -> float:
    """What most values stay below, as their better quarter shows.

    Parameters
    ----------
    values : ndarray
        Misfits, none of them negative; at least one.
    scatter : float
        Times what the best twentieth leaves less than that quarter, as of `SCATTER`.
    """
    low, quarter = np.quantile(values, (0.05, 0.25))
    return max(float(_NOISE * quarter), float(quarter + scatter * (quarter - low)))


def drop_unsure(
    steps: ContrastSteps, expected: ExpectedSteps, orders: list[int], choice: NDArray[np.intp]
) -> None:
    """Take their order from pieces whose steps do not tell it for sure, but for the commonest.

    Parameters
    ----------
    steps, expected, orders, choice
        As of `settle`.
    """
    commonest = np.bincount(choice[choice >= 0], minlength=len(orders)).argmax()
    for index in np.flatnonzero(np.arange(len(orders)) != commonest):
        labels: Any
        count, labels = cv2.connectedComponents((choice == index).view(np.uint8), connectivity=4)
        for label in range(1, count):
            weight = np.where(labels == label, steps.weight, np.float32(0))
            told = ContrastSteps(steps.first, 0, steps.step, weight).decoded(expected)
            if not told.sure or told.order != orders[index]:
                choice[labels == label] = -1


def settle(
    steps: ContrastSteps,
    expected: ExpectedSteps,
    orders: list[int],
    choice: NDArray[np.intp],
    misfit: NDArray[np.float32],
    fits: NDArray[np.bool_],
    rows: int,
) -> None:
    """Give pieces without an order that of what lies beside them, if it can be theirs.

    Noise and dirt may hide it in every word. It is theirs if of all the panel's orders it fits all
    their steps together best, which by chance it does in one of a hundred pieces; or if nothing
    else lies beside and their steps misfit by no more than their own scatter leads to expect, or
    fit where added light is no part of them.

    Parameters
    ----------
    steps : ContrastSteps
    expected : ExpectedSteps
    orders : list of int
    choice : ndarray, shape (rows, fringes)
        Index of each step's order, -1 for none; changed in place.
    misfit : ndarray, shape (rows, fringes)
        Of the best order around each step, as `around` tells it.
    fits : ndarray, shape (rows, fringes), bool
        Steps around which the first order fits in any light.
    rows : int
        That are judged together.
    """
    known = steps.weight > 0
    ratio = misfit / np.maximum(around(steps.noise(expected), known, rows), np.float32(_FAINT))
    usual = ratio < most_of(ratio[known], SCATTER)
    labels: Any
    count, labels = cv2.connectedComponents((choice < 0).view(np.uint8), connectivity=4)
    for label in range(1, count):
        piece = labels == label
        seen = usual[piece & known]
        rim: Any = cv2.dilate(piece.view(np.uint8), np.ones((3, 3), np.uint8))
        beside = np.unique(choice[(rim > 0) & ~piece])
        weight = np.where(piece, steps.weight, np.float32(0))
        told = ContrastSteps(steps.first, 0, steps.step, weight).decoded(expected)
        fitting = [each for each in beside if orders[each] == told.order]
        if fitting:
            choice[piece] = fitting[0]
        elif len(beside) == 1 and len(seen):
            in_light = beside[0] == 0 and fits[piece & known].mean() > _HALF
            if in_light or seen.mean() > _HALF:
                choice[piece] = beside[0]
