"""Whether dents of two frames agree in what they are and in their sizes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import MeasuredDent

# Sizes agree within so many standard uncertainties, to which a part of the size is added.
_AGREE, _OF_SIZE = 4.0, 0.08

Field = NDArray[np.float64]


def agreement(seen: Sequence[MeasuredDent], known: Sequence[MeasuredDent]) -> Field:
    """Chi-square of the sizes' differences; infinite where they cannot be the same."""
    result = np.zeros((len(seen), len(known)))
    signs = [np.array([np.sign(d.depth.value) for d in each]) for each in (seen, known)]
    result[signs[0][:, None] != signs[1]] = np.inf
    steps = [np.array([d.kind == 'step' for d in each]) for each in (seen, known)]
    result[steps[0][:, None] | steps[1]] = np.inf
    cut = np.array([d.is_cut for d in seen])[:, None] | np.array([d.is_cut for d in known])
    for name in ('depth', 'length', 'width'):
        one, other = ([getattr(d, name) for d in each] for each in (seen, known))
        values = np.array([e.value for e in one])[:, None], np.array([e.value for e in other])
        sigma = [np.nan_to_num([e.uncertainty for e in each]) for each in (one, other)]
        spread = np.sqrt(
            sigma[0][:, None] ** 2
            + sigma[1] ** 2
            + (_OF_SIZE * np.minimum(np.abs(values[0]), np.abs(values[1]))) ** 2
        )
        off = np.abs(values[0] - values[1]) / np.maximum(spread, 1e-9)
        off = np.where(cut, 0.0, np.nan_to_num(off))
        result += np.where(off < _AGREE, off**2, np.inf)
    return result
