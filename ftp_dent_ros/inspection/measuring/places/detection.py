"""Where the skin departs from its contour beyond the noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.outlines.moments import Moments
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.evidence import SIGNIFICANT
from ftp_dent_ros.inspection.measuring.skin.gaps import GAP, beside_gaps, between, gaps_of
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import median_of

_EDGE = 3.0
#: Part of the smallest depth that a smoothed place has at least.
LEAST = 0.5

Mask = NDArray[np.bool_]
Map = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A connected place that departs from the contour.

    Attributes
    ----------
    sign : int
        1 inward, -1 outward.
    rows, columns : ndarray, shape (cells,)
        Of its cells in the lattice.
    height : float
        Of the smoothed deviation at its largest, metres.
    area : float
        Square metres.
    length, width : float
        Axes of the ellipse with its second moments, metres.
    gap : ndarray, shape (2, cells)
        Rows and columns of cells without points that it surrounds or borders on.
    """

    sign: int
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    height: float
    area: float
    length: float
    width: float
    gap: NDArray[np.intp]


def find_candidates(
    skin: BareSkin,
    panel: Mask,
    lattice: Lattice,
    settings: SmallestDent,
) -> list[Candidate]:
    """Places of one panel where a smoothed deviation exceeds its noise.

    Parameters
    ----------
    skin : BareSkin
    panel : ndarray, shape (rows, columns), bool
        Cells to look at.
    lattice : Lattice
    settings : SmallestDent
    """
    found = []
    maps, noise = skin.maps, skin.noise
    gaps = gaps_of(panel, round(GAP * settings.smallest_width / max(lattice.spacing)))
    gaps &= ~lattice.valid
    floor = 0.5 * LEAST * settings.smallest_depth
    spreads = [noise.after(scale) for scale in noise.scales[1:]]
    typical = [median_of(spread[panel]) if panel.any() else 0.0 for spread in spreads]
    calm = [noise.where(0.0, scale) for scale in noise.scales[1:]]
    least = [max(SIGNIFICANT * usual, 2 * floor) for usual in calm]
    quiet = [k for k, usual in enumerate(typical) if SIGNIFICANT * usual < 4 * floor]
    base = quiet[0] if quiet else len(maps) - 1
    spread = spreads[base]
    ratios = [smooth / unsure for smooth, unsure in zip(maps, spreads, strict=True)]
    beside = None
    if gaps.any():
        beside = beside_gaps(
            maps[0], noise, noise.scales[1], SIGNIFICANT, floor, panel, gaps, lattice
        )
    for sign in (1, -1):
        values = np.where(panel & np.isfinite(maps[base]), sign * maps[base], 0)
        above = values > np.maximum(_EDGE * spread, floor)
        # By how many standard deviations of what the cloud states, where that is what counts.
        evidence = np.zeros(panel.shape, np.float32)
        for smooth, deep, ratio in zip(maps, least, ratios, strict=True):
            deeper = smooth > deep if sign > 0 else smooth < -deep
            np.maximum(evidence, sign * ratio, out=evidence, where=deeper)
        if beside is not None:
            near = beside[0 if sign > 0 else 1]
            above |= near
            evidence[near] = SIGNIFICANT
            above |= between(above, gaps)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(above.astype(np.uint8))
        seeded = np.unique(labels[(evidence >= SIGNIFICANT) & above])
        for index in seeded[seeded > 0]:
            left, top, width, height, _ = stats[index]
            window = slice(top, top + height), slice(left, left + width)
            part = labels[window] == index
            known = part & ~gaps[window]
            height = max(_highest(sign * smooth[window][known]) for smooth in maps)
            corner = np.array([[top], [left]])
            moments = Moments.of(part)
            size = moments.cells * math.prod(lattice.spacing), *moments.ellipse(*lattice.spacing)
            cells = np.array(np.nonzero(known)) + corner
            gap = np.array(np.nonzero(part & gaps[window])) + corner
            found.append(Candidate(sign, cells[0], cells[1], height, *size, gap))
    return found


def _highest(values: Map) -> float:
    """Largest of the values that are known, 0 if none is."""
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else 0.0
