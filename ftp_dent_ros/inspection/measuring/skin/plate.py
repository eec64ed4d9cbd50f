"""Plates that lie on a panel, riveted or bonded: doublers and patches that are seen whole."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.second_panel import beside_contour, rise_of
from ftp_dent_ros.inspection.measuring.skin.smoothing import shown

# Part of what a sharp edge of a plate's height would rise by that its own does, on all of its
# border but a twentieth: of plates 0.7 to 2 mm thick in simulation 0.97 and more, 0.6 to 1.2 m
# away, of dents and bumps of 40 mm and more 0.7 at most.
_STEPPED, _BUT = 0.85, 0.05
# Resolutions that an edge rises within, about, and metres if they are not known.
_WITHIN, _SUPPOSED = 0.48, 0.004

Mask = NDArray[np.bool_]
Map = NDArray[np.float32]


def plates(
    contour: Contour,
    lattice: Lattice,
    deviation: Map,
    raised: list[Mask],
    part: Mask,
    tolerance: float,
) -> Iterator[tuple[Mask, Mask]]:
    """Those of the places that stand out that are plates: flat beside the skin, a step all round.

    Parameters
    ----------
    contour : Contour
        Of the panel that they lie on.
    lattice : Lattice
    deviation : ndarray, shape (rows, columns), float32
        Depth below the contour, metres.
    raised : list of ndarray, shape (rows, columns), bool
        Connected cells that stand out, of each place.
    part : ndarray, shape (rows, columns), bool
        All cells that the contour was fitted to.
    tolerance : float
        Deviation within which cells agree with the contour, metres.

    Yields
    ------
    agreed, whole : ndarray, shape (rows, columns), bool
        A plate's cells that are flat, and all of it, with the dents in it.
    """
    if not raised:
        return
    stated = math.nan if lattice.resolution is None else float(np.nanmedian(lattice.resolution))
    within = _WITHIN * stated if math.isfinite(stated) else _SUPPOSED
    spacing = max(lattice.spacing)
    reach = max(1, round(within / 2 / spacing))
    sharp = _sharp(2 * reach * spacing / stated) if math.isfinite(stated) else 1.0
    rise, measured = rise_of(deviation, part, reach)
    for place in raised:
        agreed = beside_contour(contour, lattice, deviation, place, tolerance)
        if agreed is None:
            continue
        height = sharp * float(np.median(-deviation[agreed]))
        if _is_stepped(place, rise, measured, height):
            yield agreed, place | _dented(place, rise, measured, height)


def _is_stepped(place: Mask, rise: Map, measured: Mask, height: float) -> bool:
    """Whether a place rises, or falls, all round as an edge does."""
    kernel = np.ones((3, 3), np.uint8)
    ring = (cv2.dilate(place.view(np.uint8), kernel) > 0) & ~place
    border = ring & measured
    if border.sum() < (1 - _BUT) * ring.sum():
        return False
    return bool(np.quantile(rise[border], _BUT) > _STEPPED * height)


def _dented(place: Mask, rise: Map, measured: Mask, height: float) -> Mask:
    """What a plate surrounds, but for openings, which have a step all round as it has."""
    rim = np.pad(place.view(np.uint8), 1)
    outside = 2
    cv2.floodFill(rim, None, (0, 0), outside, flags=4)
    within = (rim[1:-1, 1:-1] != outside) & ~place
    count, labels = cv2.connectedComponents(within.view(np.uint8))
    for index in range(1, count):
        if _is_stepped(labels == index, rise, measured, height):
            within &= labels != index
    return np.asarray(within)


@lru_cache(maxsize=64)
def _sharp(span: float) -> float:
    """Part of a sharp edge's height that a cloud shows within a span, in its resolutions."""
    steps = 40
    edge = np.repeat([0.0, 1.0], 5 * steps)
    half = max(1, round(span * steps / 2))
    seen = shown(edge, 1 / steps, 1.0)
    return float(seen[5 * steps + half] - seen[5 * steps - half])
