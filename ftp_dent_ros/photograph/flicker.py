"""How the projector's light changes in strength and colour from photograph to photograph.

A DLP projector shows its colours one after the other, a laser scanner a line at a time: an
exposure that is no whole number of their frames catches more of one than of the other, each time
another part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.photograph.photograph import FULL, Photograph

#: Photographs that are looked back on; fewer than three tell nothing.
LAST = 12
#: Parts of the light: more than the first should not be, more than the second spoils clouds.
SOME, MUCH = 0.01, 0.04
# Pixels and coordinates of points that are looked at, about: the mean over the crests is right to
# two thousandths.
_SAMPLES = 20_000
# Per cent of the pixels that the brightest crests are brighter than.
_BRIGHTEST = 98


@dataclass(frozen=True)
class Flicker:
    """Standard deviations from photograph to photograph, as parts of the light.

    Attributes
    ----------
    strength : float
        Of all light.
    colour : float
        Of the share of the colour that changes most; 0 of grey photographs.
    """

    strength: float
    colour: float

    @property
    def worst(self) -> float:
        """The larger of the two."""
        return max(self.strength, self.colour)

    @property
    def text(self) -> str:
        """The two in per cent."""
        return f'strength {100 * self.strength:.1f} %, colour {100 * self.colour:.1f} %'


def light_of(photograph: Photograph) -> NDArray[np.float64]:
    """Mean level of the fringes' crests in each colour, shape (3,); grey ones have three alike."""
    pixels = photograph.pixels
    if photograph.mosaic:
        rows, columns = photograph.height // 2, photograph.width // 2
        tiles = {
            colour: pixels[row::2, column::2][:rows, :columns]
            for colour, row, column in photograph.lattices()
        }
        some = np.stack([_some(tiles[colour]) for colour in 'rgb'], axis=-1)
    else:
        some = _some(pixels)
    colours = some.reshape(len(some), -1).T
    level = np.maximum.reduce(list(colours))
    crest = level > np.percentile(level, _BRIGHTEST) / 2
    crest &= level < FULL * photograph.white
    if not crest.any():
        return np.full(3, np.nan)
    means = [photograph.unit * colour[crest].mean() for colour in colours]
    return np.broadcast_to(np.array(means, float), 3).copy()


def fall_of_light(points: NDArray[np.floating], source: NDArray[np.float64]) -> float:
    """How much of a steady lamp's light falls on a skin: the mean of cos(angle) / distance².

    What `light_of` sees of a moving skin is divided by it, so that what is left changes with the
    lamp, and not with how the skin lies to it.

    Parameters
    ----------
    points : ndarray, shape (rows, columns, 3)
        Metres; NaN where there is none.
    source : ndarray, shape (3,)
        The lamp, in the points' frame.

    Returns
    -------
    float
        1/m²; NaN without points side by side.
    """
    every = max(1, math.isqrt(points.size // _SAMPLES))  # the fall of the light is smooth
    some = points[::every, ::every].astype(float)
    right, down = np.diff(some, axis=1)[:-1], np.diff(some, axis=0)[:, :-1]
    normal, ray = np.cross(right, down), some[:-1, :-1] - source
    share = np.abs((normal * ray).sum(axis=-1)) / np.linalg.norm(normal, axis=-1)
    share /= np.linalg.norm(ray, axis=-1) ** 3
    known = share[np.isfinite(share)]
    return float(known.mean()) if known.size else float('nan')


def _some(pixels: NDArray) -> NDArray:
    """Some pixels at random, the same of each photograph: fringes beat with any grid."""
    return pixels.reshape(-1, *pixels.shape[2:])[_places(pixels.shape[0] * pixels.shape[1])]


@lru_cache(maxsize=4)
def _places(count: int) -> NDArray[np.intp]:
    return np.sort(np.random.default_rng(0).integers(0, count, _SAMPLES))


def flicker(lights: Sequence[NDArray]) -> Flicker | None:
    """Flicker of a series of photographs; None of fewer than three that show light.

    What changes evenly is another view, not the projector: second differences are judged, which of
    independent values have six times their variance.

    Parameters
    ----------
    lights : sequence of ndarray, shape (3,)
        As `light_of` gives them, over `fall_of_light` where the skin moves, in the order of the
        photographs.
    """
    known = np.array([light for light in lights if np.isfinite(light).all() and light.min() > 0])
    if len(known) < 3:
        return None
    share = known / known.sum(axis=1, keepdims=True)
    series = np.column_stack([np.log(known.sum(axis=1)), np.log(share)])
    spread = np.sqrt(np.mean(np.square(np.diff(series, 2, axis=0)), axis=0) / 6)
    return Flicker(float(spread[0]), float(spread[1:].max()))
