"""Where the skin departs from its contour beyond the noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.outlines.moments import NOISY, Moments
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.evidence import SIGNIFICANT, SUSPECT
from ftp_dent_ros.inspection.measuring.places.lines import valleys
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
    is_valley : bool
        Whether it is significant along its length, whatever single places of it are.
    """

    sign: int
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    height: float
    area: float
    length: float
    width: float
    gap: NDArray[np.intp]
    is_valley: bool = False


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
        told = maps[0], noise, noise.scales[1]
        beside = beside_gaps(*told, skin.suspect, floor, panel, gaps, lattice)
    for sign in (1, -1):
        values = np.where(panel & np.isfinite(maps[base]), sign * maps[base], 0)
        above = values > np.maximum(_EDGE * spread, floor)
        # By how many standard deviations of what the cloud tells, where that is what counts.
        evidence = np.zeros(panel.shape, np.float32)
        for smooth, deep, ratio in zip(maps, least, ratios, strict=True):
            deeper = smooth > deep if sign > 0 else smooth < -deep
            np.maximum(evidence, sign * ratio, out=evidence, where=deeper)
        if beside is not None:
            near = beside[0 if sign > 0 else 1]
            above |= near
            evidence[near] = skin.suspect
            above |= between(above, gaps)
        lines = np.zeros_like(above)
        if sign > 0:
            # It stands out of what all of the skin strays by, whatever is in doubt there.
            stands = panel & (maps[0] > max(SIGNIFICANT * typical[0], settings.smallest_depth))
            stands &= ~_connected(above, evidence >= skin.suspect)
            lines = valleys(skin, panel, stands, lattice, settings.smallest_width, floor)
            above |= lines
        _, labels, stats, _ = cv2.connectedComponentsWithStats(above.astype(np.uint8))
        seeded = np.unique(labels[((evidence > SUSPECT) | lines) & above])
        for index in seeded[seeded > 0]:
            left, top, width, height, _ = stats[index]
            window = slice(top, top + height), slice(left, left + width)
            part = labels[window] == index
            known = part & ~gaps[window]
            height = max(_highest(sign * smooth[window][known]) for smooth in maps)
            corner = np.array([[top], [left]])
            moments = Moments.of(part)
            size = moments.cells * math.prod(lattice.spacing), *moments.ellipse(*lattice.spacing)
            # What is long has so many places that tell the same.
            seen, alike = evidence[window][known].max(), max(size[1] / (NOISY * size[2]), 1.0)
            valley = bool(lines[window][part].any())
            valley &= size[1] > settings.smallest_width
            together = valley or seen >= skin.suspect / math.sqrt(alike)
            if not together:
                continue
            cells = np.array(np.nonzero(known)) + corner
            gap = np.array(np.nonzero(part & gaps[window])) + corner
            found.append(Candidate(sign, cells[0], cells[1], height, *size, gap, valley))
    return found


def _connected(marked: Mask, seeds: Mask) -> Mask:
    """Cells of the marked parts that have a seed."""
    _, labels = cv2.connectedComponents(marked.view(np.uint8))
    chosen = np.zeros(labels.max() + 1, bool)
    chosen[labels[seeds & marked]] = True
    chosen[0] = False
    return np.asarray(chosen[labels])


def _highest(values: Map) -> float:
    """Largest of the values that are known, 0 if none is."""
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else 0.0
