"""Which terms the data carry: each candidate is judged on poses that it was not fitted to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.adjustment.bundle import Estimate, adjust
from ftp_dent_ros.calibration.adjustment.model import DISTORTIONS, Model
from ftp_dent_ros.calibration.observing.observation import Observation

# Parts of the poses, each of which is held out in turn.
_FOLDS = 4
# Fewer poses than this left for fitting do not hold a rig down.
_FEWEST_TO_FIT = 3
# Gross errors must not decide, standard deviations.
_CLIP = 3.0
# Scores differ by more than this part.
_TOLERANCE = 1e-5


def select(
    observations: list[Observation],
    board: NDArray[np.float64],
    estimate: Estimate,
    model: Model,
    shapes: tuple[str, ...],
    progress: Callable[[str], None],
) -> tuple[Model, dict[Model, float]]:
    """Choose distortion terms and the board's shape by cross-validation.

    Parameters
    ----------
    observations, board
    estimate : Estimate
        With all terms: where each candidate starts.
    model : Model
        Of `estimate`.
    shapes : tuple of str
        Candidates for the board's shape.
    progress : callable
        Told after each candidate.

    Returns
    -------
    model : Model
    scores : dict
        Mean squared held-out residual, in units of the estimated variance, of each candidate.
    """
    scores: dict[Model, float] = {}

    def score(candidate: Model) -> float:
        if candidate not in scores:
            scores[candidate] = held_out_score(observations, board, estimate, candidate)
            progress(f'{candidate.shape}, {candidate.camera}+{candidate.projector}')
        return scores[candidate]

    best = model
    for name, values in (
        ('shape', shapes),
        ('projector', range(len(DISTORTIONS))),
        ('camera', range(len(DISTORTIONS))),
    ):
        tried = [replace(best, **{name: value}) for value in values]  # type: ignore[arg-type]
        best = min(tried, key=score)
    return best, scores


def candidates(shapes: tuple[str, ...]) -> int:
    """How many candidates `select` judges."""
    return len(shapes) + 2 * (len(DISTORTIONS) - 1)


def folds(count: int, wanted: int = _FOLDS) -> list[NDArray[np.intp]]:
    """Indices of the poses held out in turn; none if too few would be left."""
    wanted = min(wanted, count)
    while wanted < count and count - -(-count // wanted) < _FEWEST_TO_FIT:
        wanted += 1
    if count - -(-count // wanted) < _FEWEST_TO_FIT:
        return []
    return [np.arange(first, count, wanted) for first in range(wanted)]


def held_out_score(
    observations: list[Observation], board: NDArray, estimate: Estimate, candidate: Model
) -> float:
    """Mean squared residual of poses that a candidate was not fitted to."""
    total, number = 0.0, 0
    for out in folds(len(observations)):
        for residuals in held_out(observations, board, estimate, candidate, out)[0]:
            known = np.isfinite(residuals)
            off = np.abs(residuals / np.repeat(estimate.deviations, 2))[known]
            total += float(np.square(np.minimum(off, _CLIP)).sum())
            number += int(known.sum())
    return total / max(number, 1)


def held_out(
    observations: list[Observation],
    board: NDArray,
    estimate: Estimate,
    candidate: Model,
    out: NDArray[np.intp],
) -> tuple[list[NDArray[np.float64]], Estimate]:
    """Residuals of the poses `out` with a rig of the others, and that rig's estimate.

    Of the held-out poses only where the board was is estimated.
    """
    kept = np.setdiff1d(np.arange(len(observations)), out)
    fitted = adjust(
        [observations[i] for i in kept],
        board,
        estimate.rig,
        estimate.poses[kept],
        candidate,
        shape=estimate.shape,
        deviations=estimate.deviations,
        tolerance=_TOLERANCE,
    )
    seen = adjust(
        [observations[i] for i in out],
        board,
        fitted.rig,
        estimate.poses[out],
        replace(candidate, shape='flat'),
        free='none',
        shape=fitted.shape,
        deviations=estimate.deviations,
        tolerance=_TOLERANCE,
    )
    return seen.residuals, fitted
