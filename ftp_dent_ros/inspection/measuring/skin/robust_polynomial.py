"""Polynomials of degree 2 and more, with a sagitta, fitted to what most points agree on."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin import equations

# Tukey's biweight: full efficiency is 95 % at this many standard deviations.
_TUKEY = 4.7
_SHRINK = 0.6
_STEEPEST = 0.9

Field = NDArray[np.floating]


def alike(x: Field, y: Field, left: Field, weight: Field) -> float:
    """Number of neighbours that err alike, from the means of groups of about 16."""
    kept = weight > 0
    x, y, left = x[kept], y[kept], left[kept]
    side = 4 * math.sqrt(np.ptp(x) * np.ptp(y) / max(len(x), 1)) + 1e-12
    _, group = np.unique(np.floor(x / side) + 1e4 * np.floor(y / side), return_inverse=True)
    count = np.bincount(group)
    mean = np.bincount(group, left) / count
    full = count >= 6
    if full.sum() < 4:
        return 1.0
    square = float(np.mean(left**2))
    return float(np.clip(np.mean((count * mean**2)[full]) / square, 1, 16)) if square else 1.0


def redescended(x, y, w, scale, start, noise) -> tuple[float, NDArray[np.float64]]:
    """Cost and coefficients of a fit that starts from some points and narrows down."""
    x, y, w = x / scale, y / scale, w / scale
    columns = basis(x, y, 6)
    coefficients = solved(columns, w, start.astype(float), np.zeros(6))
    left = w - model(columns, coefficients, x, y)
    floor = noise / scale
    if start.all():
        width = max(1.5 * float(np.median(np.abs(left))), floor)
        # Least absolute deviations first: the biweight would drop points for good.
        for _ in range(3):
            weight = 1 / np.maximum(np.abs(left), 0.3 * width)
            coefficients = solved(columns, left, weight, coefficients)
            left = w - model(columns, coefficients, x, y)
    width = max(1.5 * float(np.median(np.abs(left[start]))), floor)
    coefficients = narrowed(columns, w, coefficients, x, y, width, floor)
    left = np.abs(w - model(columns, coefficients, x, y))
    return float(np.minimum(left / (_TUKEY * floor), 1).mean()), coefficients


def narrowed(columns, w, coefficients, x, y, width, floor) -> NDArray[np.float64]:
    """Coefficients by biweights that shrink from `width` to `floor`."""
    while True:
        for _ in range(2):
            left = w - model(columns, coefficients, x, y)
            weight = biweight(left / (_TUKEY * width))
            coefficients = solved(columns, left, weight, coefficients)
        if width == floor:
            return coefficients
        width = max(_SHRINK * width, floor)


def polished(x, y, w, scale, coefficients, noise) -> NDArray[np.float64]:
    """Coefficients by Tukey's biweight from nearby ones."""
    x, y, w = x / scale, y / scale, w / scale
    columns = basis(x, y, len(coefficients))
    for width in (2.0, 1.4, 1.0, 1.0, 1.0):
        left = w - model(columns, coefficients, x, y)
        weight = biweight(left * scale / (_TUKEY * noise * width))
        coefficients = solved(columns, left, weight, coefficients)
    return coefficients


def solved(columns, left, weight, coefficients) -> NDArray[np.float64]:
    """Weighted least squares from what coefficients leave, the sagitta's excess as with them.

    Where fewer points bear weight than there are unknowns, the coefficients stay.
    """
    if np.count_nonzero(weight) < len(coefficients):
        return coefficients
    weighted = columns * weight[:, None]
    normal = weighted.T @ columns
    right = weighted.T @ left + normal @ coefficients
    normal.flat[:: len(normal) + 1] += 1e-9 * normal.trace()
    return equations.solved(normal, right)


def model(columns, coefficients, x, y):
    """Heights: the polynomial with the sagitta in place of its second degree."""
    others = coefficients.copy()
    others[3:6] = 0
    return columns @ others + sagitta(coefficients, x, y)


def sagitta(c, x: Field, y: Field) -> Field:
    """Height of a surface whose curvatures are those of the quadratic form c3, c4, c5."""
    along_x, along_y = 2 * c[3] * x + c[4] * y, c[4] * x + 2 * c[5] * y
    square = along_x * along_x + along_y * along_y
    flat = np.sqrt(1 - np.minimum(square, x.dtype.type(_STEEPEST)))
    return (along_x * x + along_y * y) / (1 + flat)


def biweight(ratio: Field) -> Field:
    """Weight of Tukey's biweight, 0 from a ratio of 1 on."""
    return np.square(1 - np.minimum(ratio * ratio, 1))


@cache
def powers(terms: int) -> tuple[tuple[int, int], ...]:
    """Exponents of x and y: all of degree 0, 1, 2 and so on."""
    degree = int((math.isqrt(8 * terms + 1) - 3) // 2)
    return tuple((n - j, j) for n in range(degree + 1) for j in range(n + 1))


def basis(x: Field, y: Field, terms: int) -> NDArray[np.float64]:
    """Monomials at x, y, shape (n, terms)."""
    return np.array([x**i * y**j for i, j in powers(terms)], float).T


def some(points: NDArray, count: int, rng: np.random.Generator) -> NDArray:
    """About `count` of the points, spread evenly."""
    if len(points) <= count:
        return points.astype(float)
    return points[rng.choice(len(points), count, replace=False)].astype(float)
