"""Values as people and files read them."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timezone
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import COVERAGE, Estimate


def interval(estimate: Estimate, factor: float = 1e3, finest: int = 2) -> tuple[str, str]:
    """A value and half its 95 % interval, in as many digits as that has a meaning."""
    value, half = estimate.value * factor, COVERAGE * estimate.uncertainty * factor
    if not math.isfinite(value):
        return '–', ''
    if not half:
        return f'{value:.3g}', ''
    places = -math.floor(math.log10(half))
    # At least one digit of the interval, two where they are not finer than can be of use.
    digits = max(min(places + 1, finest), places, 0)
    return f'{value:.{digits}f}', f'± {half:.{digits}f}'


def position_interval(covariance: NDArray[np.float64]) -> str:
    """Half the 95 % interval of a place of covariance (3, 3), along any axis in the mean."""
    return spread(deviation_of(covariance))


def deviation_of(covariance: NDArray[np.float64]) -> float:
    """Standard deviation along any axis in the mean, of a covariance (3, 3)."""
    return math.sqrt(float(np.trace(covariance)) / 3)


def spread(uncertainty: float) -> str:
    """Half a 95 % interval in millimetres and two digits, of a standard uncertainty in metres."""
    half = float(f'{COVERAGE * uncertainty * 1e3:.2g}')
    return f'± {half:g} mm'  # never with an exponent, as 110 of .2g alone has


def iso_time(nanoseconds: int) -> str:
    """UTC to a millisecond, ISO 8601."""
    time = datetime.fromtimestamp(nanoseconds // 1_000_000 / 1000, timezone.utc)
    return time.isoformat(timespec='milliseconds').replace('+00:00', 'Z')


def date_of(nanoseconds: int) -> str:
    """UTC, ISO 8601."""
    return iso_time(nanoseconds)[:10]


def table(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Some columns of rows as CSV, under their names; None is an empty cell."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, extrasaction='ignore', lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def finite(value: Any) -> Any:
    """The same data with None for numbers that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
