"""The median, quickly."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def median(values: NDArray[np.floating]) -> float:
    """Median of finite values, shape (n,), NaN of none.

    NumPy's takes several times as long over its checks.
    """
    half = len(values) // 2
    if not len(values):
        return math.nan
    if len(values) % 2:
        return float(np.partition(values, half)[half])
    low, high = np.partition(values, (half - 1, half))[half - 1 : half + 1]
    return float((low + high) / 2)
