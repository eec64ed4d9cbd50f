"""Contours fitted to points of which some lie on dents, or on other parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.contour import Contour, Field
from ftp_dent_ros.inspection.measuring.skin.robust_polynomial import (
    alike,
    basis,
    biweight,
    model,
    narrowed,
    polished,
    redescended,
    some,
)

# Tukey's biweight: full efficiency is 95 % at this many standard deviations.
_TUKEY = 4.7
# Points that a contour is fitted to, and those that starts are compared by.
_SAMPLES, _FEW = 1500, 300
# Terms of the fourth degree.
_RICH = 15
# Cost of a fit that is good enough to be the only one: most of the points lie on it.
_AGREED = 0.3


def first_contour(
    points: NDArray, viewpoint: NDArray[np.float64], noise: float, rng: np.random.Generator
) -> Contour:
    """Contour that most of the points agree on, the others left out.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    viewpoint : ndarray, shape (3,)
        Of the camera, on the outer side.
    noise : float
        Standard deviation that points of the skin have, metres.
    rng : numpy.random.Generator
        Draws the points that are looked at, of many.
    """
    points = some(points, _SAMPLES, rng)
    contour = _plane(points, viewpoint)
    few = some(points, _FEW, rng)
    x, y, w = contour.local(few)
    fits = [redescended(x, y, w, contour.scale, np.ones(len(few), bool), noise)]
    if fits[0][0] > _AGREED:
        halves = [half for along in (x, y) for half in _halves(along)]
        fits += [redescended(x, y, w, contour.scale, half, noise) for half in halves]
    best = min(fits, key=lambda fit: fit[0])[1]
    for _ in range(2):
        # Again over the plane that is tangent to it: the sagitta is about its foot.
        contour = _tangent(replace(contour, coefficients=best))
        x, y, w = contour.local(points)
        best = polished(x, y, w, contour.scale, contour.coefficients, noise)
    return replace(contour, coefficients=best)


def richer_contour(
    contour: Contour, points: NDArray, noise: float, rng: np.random.Generator
) -> Contour:
    """The contour with all terms up to the fourth degree, for skin that no quadric meets."""
    points = some(points, _SAMPLES, rng)
    x, y, w = (axis / contour.scale for axis in contour.local(points))
    columns = basis(x, y, _RICH)
    start = np.zeros(_RICH)
    start[: contour.terms] = contour.coefficients
    left = np.abs(w - model(columns, start, x, y))
    floor = noise / contour.scale
    width = max(1.5 * float(np.median(left)), floor)
    found = narrowed(columns, w, start, x, y, width, floor)
    return replace(contour, coefficients=found, covariance=np.zeros((_RICH, _RICH)))


def refined(contour: Contour, points: NDArray, noise: float) -> Contour:
    """The contour fitted again to points of the bare skin, shape (n, 3), with its covariance.

    Parameters
    ----------
    contour : Contour
    points : ndarray, shape (n, 3)
    noise : float
        Their standard deviation, metres. How far it is correlated is seen from the fit.
    """
    x, y, w = contour.local(points)
    terms = contour.terms
    coefficients = polished(x, y, w, contour.scale, contour.coefficients, noise)
    columns = basis(x / contour.scale, y / contour.scale, terms)
    left = w / contour.scale - model(columns, coefficients, x / contour.scale, y / contour.scale)
    weight = biweight(left * contour.scale / (_TUKEY * noise))
    share = max(weight.sum() - terms, 1.0)
    variance = (weight * left * left).sum() / share
    inverse = np.linalg.pinv(columns.T @ (columns * weight[:, None]))
    together = alike(x, y, left, weight)
    return replace(contour, coefficients=coefficients, covariance=together * variance * inverse)


def _halves(along: Field) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    middle = np.median(along)
    return along > middle, along < middle


def _plane(points: NDArray, viewpoint: NDArray[np.float64]) -> Contour:
    """Frame of the principal axes, w away from the viewpoint."""
    origin = np.median(points, axis=0).astype(float)
    centred = points - origin
    _, axes = np.linalg.eigh(centred.T @ centred)
    inward = axes[:, 0]
    if inward @ (origin - viewpoint) < 0:
        inward = -inward
    along = axes[:, 2]
    frame = np.stack([along, np.cross(inward, along), inward])
    scale = float(np.abs(centred).max())
    return Contour(origin, frame, scale, np.zeros(6), np.zeros((6, 6)))


def _tangent(contour: Contour) -> Contour:
    """The same contour over its tangent plane at the origin, to first order."""
    at = np.zeros(1)
    (origin,), (outward,) = contour.foot(at, at)
    inward = -outward
    along = contour.axes[0] - inward * (contour.axes[0] @ inward)
    along /= np.linalg.norm(along)
    frame = np.stack([along, np.cross(inward, along), inward])
    coefficients = contour.coefficients.copy()
    coefficients[:3] = 0
    return replace(contour, origin=origin, axes=frame, coefficients=coefficients)
