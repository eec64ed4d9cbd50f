"""The median, quickly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def median(values: NDArray[np.floating]) -> float:
    """Median, the upper one of two; NumPy's takes several times as long over its checks."""
    half = values.size // 2
    return float(np.partition(values.ravel(), half)[half])
