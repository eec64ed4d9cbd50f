"""From which depth on a dent of the smallest width would have been listed, at each place.

What must be seen is what the rules ask for: to be a place at all (`places/detection.py`), to be
evident, as deep as the smallest dent, and known well enough to be a dent (`measurement.py`). What
is seen of a Gaussian as wide as the smallest dent is what the reconstruction's windows and the
smoothing leave of it, which are Gaussians too, so that all of it is known in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, reduce

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.measurement import CERTAIN, SUPPOSED
from ftp_dent_ros.inspection.measuring.outlines.restoration import DOUBT
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.detection import LEAST
from ftp_dent_ros.inspection.measuring.places.evidence import FITTED, SIGNIFICANT, TENTH
from ftp_dent_ros.inspection.measuring.places.kinds import STEEP
from ftp_dent_ros.inspection.measuring.sizes import OF_DEPTH, UNRESOLVED_DEPTH
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.smoothing import FITS, halved

# Of a normal distribution, 95 %: noise hides a dent that is no deeper than what must be seen in
# half of the cases.
_SURELY = 1.645
# Orders of the restoration: what it leaves out is what three times the windows do.
_ORDERS = 3
# Resolutions, as parts of the smallest width, for which is calculated what is left: steps of what
# changes nothing by 0.3 %, as far as more would make no difference.
_STEP = 0.0025
_RATIOS = np.arange(_STEP / 2, 2, _STEP)
# Places from the middle of the dent, in its widths, among which its edge is looked for.
_PLACES = np.linspace(0, 2, 401)

Map = NDArray[np.float32]
Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Asked:
    """Depth that a dent must have for what must be seen of it, over that, each of one shape.

    Attributes
    ----------
    places : tuple of ndarray
        Of its deepest place in the cloud after Gaussians of several scales.
    fitted : ndarray
        Of a Gaussian as wide that is fitted to it in the cloud.
    restored : ndarray
        Of what it is after what the windows took is put back.
    certain : ndarray
        Over the uncertainty by noise alone, for its depth to be known well enough; infinite where
        none would do.
    """

    places: tuple[Map, ...]
    fitted: Map
    restored: Map
    certain: Map


def findable_depth(skin: BareSkin, lattice: Lattice, settings: SmallestDent) -> Map:
    """Depth from which on a dent of the smallest width is listed as one, of each cell, metres.

    In 95 % of the cases. It is at most what no dent of that width has, being no dented skin any
    more: so it is where no depth would do.

    Parameters
    ----------
    skin : BareSkin
    lattice : Lattice
    settings : SmallestDent
    """
    noise, width = skin.noise, settings.smallest_width
    asked = _asked_in(lattice, tuple(float(scale / width) for scale in noise.scales[1:]), width)
    surely = np.float32(SIGNIFICANT + _SURELY)
    floor = np.float32(LEAST * settings.smallest_depth)
    places = [
        np.maximum(surely * noise.after(scale), floor) * over
        for scale, over in zip(noise.scales[1:], asked.places, strict=True)
    ]
    by_chance = noise.after(FITTED * width / TENTH)
    wavy = 0.0 if skin.relief is None else skin.relief.uncertainty(width)
    square = np.square(noise.after(0.0)) + np.square(by_chance) + np.float32(wavy**2)
    spread = np.float32(OF_DEPTH) * np.sqrt(square)
    deep = (np.float32(_SURELY) * spread + np.float32(settings.smallest_depth)) * asked.restored
    evident = surely * by_chance * asked.fitted
    least = reduce(np.maximum, (reduce(np.minimum, places), evident, deep, spread * asked.certain))
    return np.minimum(least, np.float32(STEEP * width))


def _asked_in(lattice: Lattice, scales: tuple[float, ...], width: float) -> _Asked:
    """What each cell asks for; of scales that are parts of the width."""
    table = _asked(scales)
    if lattice.resolution is not None:
        index = (lattice.resolution * np.float32(1 / (_STEP * width))).astype(np.intp)
        return _Asked(
            tuple(over.take(index, mode='clip') for over in table.places),
            *(
                over.take(index, mode='clip')
                for over in (table.fitted, table.restored, table.certain)
            ),
        )
    # Nothing is put back of a resolution that is not known; what one Gaussian would ask for is
    # the doubt.
    supposed = SUPPOSED * max(lattice.spacing) / lattice.block
    window = (TENTH * supposed / halved(1) / width) ** 2
    certain = _certain(np.ones(1), np.full(1, window / (1 + window)))
    return _Asked(
        tuple(over[:1] for over in table.places), table.fitted[:1], table.restored[:1], certain
    )


@lru_cache
def _asked(scales: tuple[float, ...]) -> _Asked:
    """The same at `_RATIOS`."""
    square = 1 / TENTH**2
    window = (_RATIOS / halved(FITS)) ** 2

    def left(fits: int, more: float = 0.0, places: Values | float = 0.0) -> Values:
        # What n fits leave is 1 - (1 - G)^n: Gaussians, each of which makes the dent's one wider.
        total = np.zeros(np.broadcast(window, places).shape)
        for k in range(1, fits + 1):
            wide = square + k * window + more
            part = (-1) ** (k + 1) * math.comb(fits, k) * square / wide
            total += part * np.exp(-np.square(places) / (2 * wide))
        return total

    once, twice, restored = (left(FITS * order) for order in range(1, _ORDERS + 1))
    across = left(FITS * _ORDERS, 0.0, _PLACES[:, None])
    width = 2 * _PLACES[np.argmax(across < restored / 10, axis=0)]
    fine = np.minimum(_RATIOS / width, 1.0) ** 2
    doubt = np.hypot(DOUBT * (twice - once), restored - twice)
    doubt = np.hypot(doubt, UNRESOLVED_DEPTH * fine * restored)
    return _Asked(
        tuple((1 / left(FITS, scale**2)).astype(np.float32) for scale in scales),
        # The product of two Gaussians over the square of one that is as wide as the dent.
        (0.5 / left(FITS, square)).astype(np.float32),
        (1 / restored).astype(np.float32),
        _certain(restored, doubt),
    )


def _certain(restored: Values, doubt: Values) -> Map:
    """Depth from which on a dent is known well enough, over the uncertainty by noise alone.

    That is s, q of it are against the dent, and of its depth d so much is restored, r, with a
    doubt of l: so that r d - q s = c (s^2 + (l d)^2)^0.5. Infinite where that has no solution, or
    where windows leave too little.
    """
    rest = restored**2 - (OF_DEPTH * CERTAIN * doubt) ** 2
    known = (rest > 0) & (SIGNIFICANT * doubt < restored)
    offset = _SURELY * restored
    root = np.sqrt(offset**2 + np.maximum(rest, 0) * (CERTAIN**2 - _SURELY**2))
    over = np.divide(offset + root, rest, out=np.full_like(rest, np.inf), where=known)
    return np.asarray(over, np.float32)
