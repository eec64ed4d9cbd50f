"""A corner's window under fringes: their light, and by how much the print lies elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Terms of the light: on white its mean, fringes and their second harmonic; on ink, which reflects
# a little, its mean and fringes.
_ON_WHITE, _ON_INK = 5, 3


@dataclass(frozen=True, eq=False)
class WindowFit:
    """What a window tells.

    Attributes
    ----------
    shift : ndarray, shape (2,)
        Of the print, pixels.
    shift_px : float
        Standard deviation of its worse part, pixels.
    phase : float
        By which the fringes lie behind those predicted, radians.
    phase_rad : float
        Standard deviation of it, radians.
    unexplained : float
        Sum of squares of what is left, levels.
    """

    shift: NDArray[np.float64]
    shift_px: float
    phase: float
    phase_rad: float
    unexplained: float


def fit_window(
    seen: NDArray,
    albedo: NDArray,
    phase: NDArray,
    contrast: NDArray,
    slope_x: NDArray,
    slope_y: NDArray,
) -> WindowFit:
    """Fit the light on white and on ink, and the print's shift, by linear least squares.

    Parameters
    ----------
    seen, albedo : ndarray, shape (m,)
        Levels of the window's pixels, and how white the print is there.
    phase, contrast : ndarray, shape (m,)
        Of the fringes as predicted.
    slope_x, slope_y : ndarray, shape (m,)
        Of the albedo, a pixel.
    """
    waves = np.column_stack(
        [
            np.ones_like(phase),
            *(contrast**n * wave(n * phase) for n in (1, 2) for wave in (np.cos, np.sin)),
        ]
    )
    on_ink = waves[:, :_ON_INK]
    still = np.column_stack([albedo[:, None] * waves, (1 - albedo)[:, None] * on_ink])
    numbers, _ = _least_squares(still, seen)
    for _ in range(2):
        step = waves @ numbers[:_ON_WHITE] - on_ink @ numbers[_ON_WHITE : _ON_WHITE + _ON_INK]
        terms = np.column_stack([still, -step * slope_x, -step * slope_y])
        numbers, inverse = _least_squares(terms, seen)
    left = float(np.square(seen - terms @ numbers).sum())
    variance = np.diag(inverse) * left / max(1, len(seen) - terms.shape[1])
    strength = max(float(np.hypot(numbers[1], numbers[2])), 1e-9)
    return WindowFit(
        numbers[-2:],
        float(np.sqrt(variance[-2:].max())),
        float(np.arctan2(numbers[2], numbers[1])),
        float(np.sqrt(variance[1:3].max())) / strength,
        left,
    )


def _least_squares(terms: NDArray, seen: NDArray) -> tuple[NDArray, NDArray]:
    """Numbers, and the inverse of the normal equations."""
    inverse = np.linalg.pinv(terms.T @ terms, hermitian=True)
    return inverse @ (terms.T @ seen), inverse
