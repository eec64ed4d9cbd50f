"""Dents of parts of a flight that nothing but the poses ties: which may be one and the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.tracking.agreement import agreement
from ftp_dent_ros.inspection.tracking.pairing import GATE, Entry


def doubles(dents: Sequence[MeasuredDent], entries: Sequence[Entry]) -> list[tuple[int, ...]]:
    """Numbers of those that each entry may be, though neither dents nor poses are sure of it.

    Within a part of a flight dents tell each other apart, and what fits is one entry already.
    Between parts places are as uncertain as the poses: where sizes agree, and places too within
    that, there may be one dent for two numbers.

    Parameters
    ----------
    dents : sequence of MeasuredDent
        Of the entries, where the list has them.
    entries : sequence of Entry
    """
    groups = np.array([entry.group for entry in entries])
    if len(set(groups.tolist())) < 2:
        return [()] * len(entries)
    places = np.stack([dent.position for dent in dents])
    spreads = np.stack([entry.listed.position_covariance for entry in entries])
    # What is cut has its centre anywhere in it.
    halves = np.array([np.nan_to_num(dent.length.value) / 2 * dent.is_cut for dent in dents])
    possible = (groups[:, None] != groups) & np.isfinite(agreement(dents, dents))
    result = []
    for index in range(len(entries)):
        others = np.flatnonzero(possible[index])
        apart = places[others] - places[index]
        cut = np.hypot(halves[others], halves[index]) / GATE
        spread = spreads[others] + spreads[index] + cut[:, None, None] ** 2 * np.eye(3)
        far = np.einsum('ni,ni->n', apart, np.linalg.solve(spread, apart[..., None])[..., 0])
        near = others[far < GATE**2]
        result.append(tuple(sorted(entries[other].listed.number for other in near)))
    return result
