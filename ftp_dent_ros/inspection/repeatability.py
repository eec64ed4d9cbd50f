"""Repeatability and reproducibility of the measurements of one flight (a gauge study)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
    within, within_degrees = 0.0, 0
    between, between_degrees = 0.0, 0
    dents = frames = 0
    shares = []
    for entry in entries:
        if entry.dent.kind != 'dent':
            continue
        means = []
        for sighting in entry.sightings:
            if sighting.dent.is_cut:
                continue
            values = np.array([getattr(dent, quantity).value for dent in sighting.repeats])
            if len(values) > 1:
                within += float(((values - values.mean()) ** 2).sum())
                within_degrees += len(values) - 1
                shares.append(1 / len(values))
                means.append(values.mean())
            else:
                means.append(getattr(sighting.dent, quantity).value)
        if len(means) > 1:
            dents, frames = dents + 1, frames + len(means)
            between += float(((means - np.mean(means)) ** 2).sum())
            between_degrees += len(means) - 1
    repeat = within / within_degrees if within_degrees else float('nan')
    if between_degrees:
        of_means = between / between_degrees
        known = np.nan_to_num(repeat) * (np.mean(shares) if shares else 0.0)
        beyond = max(of_means - known, 0.0)
    else:
        beyond = float('nan')
    total = np.sqrt(np.nansum([repeat, beyond])) if within_degrees or between_degrees else np.nan
    return Repeatability(
        quantity, dents, frames, float(np.sqrt(repeat)), float(np.sqrt(beyond)), float(total)
    )
