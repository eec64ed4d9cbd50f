"""Whether dents of two frames agree in what they are and in their sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import MeasuredDent

# Sizes agree within so many standard uncertainties, to which a part of the size is added.
_AGREE, _OF_SIZE = 4.0, 0.08
# Natural logarithm of the range over which other dents' sizes lie, at most: hail's, which is the
# most alike (depths of 1 to 4, lengths of 1 to 2.5). Widths tell little that lengths do not.
_RANGES = {'depth': 1.4, 'length': 0.9}
# Known dents from which on they tell themselves how alike they are.
_TELLING = 4

Field = NDArray[np.float64]


def agreement(seen: Sequence[MeasuredDent], known: Sequence[MeasuredDent]) -> Field:
    """Chi-square of the sizes' differences; infinite where they cannot be the same."""
    result = np.zeros((len(seen), len(known)))
    signs = [np.array([np.sign(d.depth.value) for d in each]) for each in (seen, known)]
    result[signs[0][:, None] != signs[1]] = np.inf
    steps = [np.array([d.kind == 'step' for d in each]) for each in (seen, known)]
    result[steps[0][:, None] | steps[1]] = np.inf
    for name in ('depth', 'length', 'width'):
        difference, spread, _ = _compared(name, seen, known)
        off = difference / spread
        result += np.where(off < _AGREE, off**2, np.inf)
    return result


def coincidence(seen: Sequence[MeasuredDent], known: Sequence[MeasuredDent]) -> Field:
    """How rarely sizes of two different dents would lie as near to each other as two of one.

    Natural logarithm, shape (seen, known); 0 where nothing is known of the sizes, and where those
    of the known ones are all alike. With half of `agreement` taken off, it is that of the
    likelihood ratio of one dent against two.
    """
    result = np.zeros((len(seen), len(known)))
    for name, widest in _RANGES.items():
        _, spread, size = _compared(name, seen, known)
        extent = min(widest, _range(name, known))
        result += np.log(np.fmax(extent * size / (math.sqrt(2 * math.pi) * spread), 1.0))
    return result


def _range(name: str, known: Sequence[MeasuredDent]) -> float:
    """Natural logarithm of the range of a size, as if all in it were alike frequent."""
    sizes = np.abs([getattr(each, name).value for each in known if not each.is_cut])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    return math.inf if len(sizes) < _TELLING else math.sqrt(12) * float(np.log(sizes).std(ddof=1))


def _compared(
    name: str, seen: Sequence[MeasuredDent], known: Sequence[MeasuredDent]
) -> tuple[Field, Field, Field]:
    """Difference of a size, its standard deviation, and the smaller of the two sizes, metres.

    Difference and size are 0 where it is not known, or the frame cuts the dent.
    """
    one, other = ([getattr(d, name) for d in each] for each in (seen, known))
    values = np.array([e.value for e in one])[:, None], np.array([e.value for e in other])
    sigma = [np.nan_to_num([e.uncertainty for e in each]) for each in (one, other)]
    size = np.minimum(np.abs(values[0]), np.abs(values[1]))
    spread = np.hypot(np.hypot(sigma[0][:, None], sigma[1]), _OF_SIZE * np.nan_to_num(size))
    cut = np.array([d.is_cut for d in seen])[:, None] | np.array([d.is_cut for d in known])
    told = ~cut & np.isfinite(size)
    difference = np.where(told, np.abs(values[0] - values[1]), 0.0)
    return difference, np.maximum(spread, 1e-9), np.where(told, size, 0.0)
