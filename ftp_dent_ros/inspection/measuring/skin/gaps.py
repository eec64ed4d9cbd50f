"""Where a panel has no points, and whether the skin beside that tells of a dent there."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.filling import around, membrane
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import Noise

#: Of what a dent is looked for across, in smallest widths.
GAP = 3.0
# Cells beside a gap that tell of it, and over how many metres along it.
_BESIDE, _ALONG = 2, (0.005, 0.01)
Mask = NDArray[np.bool_]
Map = NDArray[np.floating]


def gaps_of(known: Mask, reach: int) -> Mask:
    """Cells that are not known, between known ones: holes, and strips up to `reach` cells wide."""
    radius = (reach + 1) // 2
    rim = radius + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    closed = cv2.morphologyEx(np.pad(known.view(np.uint8), rim), cv2.MORPH_CLOSE, disc)
    outside = 2
    cv2.floodFill(closed, None, (0, 0), outside, flags=4)
    return (closed[rim:-rim, rim:-rim] != outside) & ~known


def beside_gaps(
    values: Map,
    noise: Noise,
    scale: float,
    least: float,
    floor: float,
    panel: Mask,
    gaps: Mask,
    lattice: Lattice,
) -> tuple[Mask, Mask]:
    """Cells beside gaps that depart from the contour together, if none does for itself.

    Those inward, and those outward.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Deviations smoothed over `scale` metres, metres; NaN where not known.
    noise : Noise
    scale : float
    least : float
        Standard deviations that the mean along a gap departs by.
    floor : float
        Metres; what departs less is not looked at.
    panel, gaps : ndarray, shape (rows, columns), bool
        Cells of the panel, and those between them that have no points.
    lattice : Lattice
    """
    size = 2 * _BESIDE + 1
    ring = cv2.dilate(gaps.view(np.uint8), np.ones((size, size), np.uint8)) > 0
    ring &= panel & np.isfinite(values)
    strays = np.where(ring, values, np.float32(0)) / np.where(
        ring, noise.after(scale), np.float32(1)
    )
    # Noise is alike across the ring, and along it over its reach.
    along = 2 * math.sqrt(math.pi) * math.hypot(noise.reach, scale) / max(lattice.spacing)
    alike = _BESIDE * max(along, 1.0)
    inward, outward = np.zeros_like(ring), np.zeros_like(ring)
    for metres in _ALONG:
        (across, down), half = lattice.cells(metres), math.sqrt(0.5)
        total = _summed(strays, across, down)
        squares = _summed(ring.astype(np.float32), half * across, half * down)
        by_chance = least * np.sqrt(np.maximum(squares * alike, 1e-9))
        inward |= total > by_chance
        outward |= total < -by_chance
    return ring & inward & (values > floor), ring & outward & (values < -floor)


def between(above: Mask, gaps: Mask) -> Mask:
    """Cells of gaps that lie rather between marked cells than between others."""
    near = cv2.dilate(above.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
    _, labels = cv2.connectedComponents(gaps.view(np.uint8))
    touched = np.unique(labels[near & gaps])
    over = np.isin(labels, touched[touched > 0])
    if not over.any():
        return over
    window = around(over)
    found = np.zeros_like(over)
    found[window] = over[window] & (membrane(above[window].astype(float), over[window]) > 0.5)
    return found


def _summed(values: Map, across: float, down: float) -> Map:
    """Sums weighted by a Gaussian whose middle weighs 1."""
    mean = cv2.GaussianBlur(values, (0, 0), across, sigmaY=down, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(mean) * (2 * math.pi * across * down)
