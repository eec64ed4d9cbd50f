"""Repeatability and reproducibility of the measurements of one flight (a gauge study)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import MeasuredDent
from ftp_dent_ros.dents.sightings import ListedDent

QUANTITIES = ('depth', 'length', 'width')


@dataclass(frozen=True)
class Repeatability:
    """Standard deviations of one quantity, metres; NaN where nothing was measured twice.

    Attributes
    ----------
    quantity : str
        One of `QUANTITIES`.
    dents, frames : int
        Dents that were seen whole in more than one frame, and how many sightings they have.
    within : float
        Within a frame (repeatability): between measurements on every second row of the same cloud.
    between : float
        Between frames, beyond that within (reproducibility): other place, angle and light.
    total : float
        Of a single measurement: both together.
    """

    quantity: str
    dents: int
    frames: int
    within: float
    between: float
    total: float


def halves(cloud: Cloud) -> tuple[Cloud, ...]:
    """Even and odd rows of a cloud: two measurements by the same photograph; none of a tiny one.

    Noise that neighbouring rows share is not seen between them.
    """
    # A side of a cloud that is large enough to be halved.
    if min(cloud.valid.shape) < 64:
        return ()
    rows = len(cloud.points) // 2 * 2
    return tuple(
        Cloud(
            cloud.points[start:rows:2],
            cloud.intensity[start:rows:2],
            cloud.sigma[start:rows:2],
            cloud.resolution[start:rows:2],
            skin=cloud.skin[start:rows:2],
        )
        for start in (0, 1)
    )


def repeats_of(
    dents: Sequence[MeasuredDent], again: Sequence[Sequence[MeasuredDent]]
) -> list[tuple[MeasuredDent, ...]]:
    """For each dent, what each other measurement of the same frame says of it."""
    result = []
    for dent in dents:
        reach = dent.width.value / 2
        same = [
            other
            for others in again
            for other in others
            if other.kind == dent.kind
            and not other.is_cut
            and np.linalg.norm(other.position - dent.position) < reach
        ]
        result.append(tuple(same) if len(same) == len(again) else ())
    return result


def study(entries: Sequence[ListedDent]) -> tuple[Repeatability, ...]:
    """Repeatability study by one-way analysis of variance, frames within dents.

    Source: ISO 5725-2 (repeatability and between-condition variance of unbalanced data).
    """
    return tuple(_study(quantity, entries) for quantity in QUANTITIES)


def _study(quantity: str, entries: Sequence[ListedDent]) -> Repeatability:
    again, means = [], []
    for entry in entries:
        of_dent = []
        for sighting in entry.sightings:
            if entry.dent.kind != 'dent' or sighting.dent.is_cut:
                continue
            values = np.array([getattr(dent, quantity).value for dent in sighting.repeats])
            if len(values) > 1:
                again.append(values)
                of_dent.append(values.mean())
            else:
                of_dent.append(getattr(sighting.dent, quantity).value)
        if len(of_dent) > 1:
            means.append(np.array(of_dent))
    repeat, of_means = _pooled_variance(again), _pooled_variance(means)
    # Of a mean, what is known by the repeats that it is made of.
    known = repeat * np.mean([1 / len(values) for values in again]) if again else 0.0
    beyond = max(of_means - known, 0.0)
    total = np.nansum([repeat, beyond]) if again or means else np.nan
    within, between, of_one = map(float, np.sqrt([repeat, beyond, total]))
    return Repeatability(quantity, len(means), sum(map(len, means)), within, between, of_one)


def _pooled_variance(groups: Sequence[NDArray[np.float64]]) -> float:
    """Variance within groups, each about its own mean; NaN of none."""
    squares = sum(float(np.square(group - group.mean()).sum()) for group in groups)
    return squares / sum(len(group) - 1 for group in groups) if groups else math.nan
