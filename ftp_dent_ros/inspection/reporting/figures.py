"""A measured value as people read it."""

from __future__ import annotations

import math

from ftp_dent_ros.inspection.dent import COVERAGE, Estimate

_MM = 1000.0


def interval(estimate: Estimate, factor: float = _MM, finest: int = 2) -> tuple[str, str]:
    """A value and half its 95 % interval, in as many digits as that has a meaning."""
    value, half = estimate.value * factor, COVERAGE * estimate.uncertainty * factor
    if not math.isfinite(value):
        return '–', ''
    if not math.isfinite(half) or half <= 0:
        return f'{value:.3g}', ''
    places = -math.floor(math.log10(half))
    # At least one digit of the interval, two where they are not finer than can be of use.
    digits = max(min(places + 1, finest), places, 0)
    return f'{value:.{digits}f}', f'± {half:.{digits}f}'
