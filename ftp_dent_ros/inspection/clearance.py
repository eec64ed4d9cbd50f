"""The distance from each dent's outline to the next dent's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.distance import cdist

from ftp_dent_ros.inspection.dent import MeasuredDent


def with_clearances(dents: Sequence[MeasuredDent]) -> tuple[MeasuredDent, ...]:
    """The dents, each with its clearance to the nearest of kind ``'dent'``."""
    outlines = [d.outline if len(d.outline) else d.position[None] for d in dents]
    centres = np.array([outline.mean(axis=0) for outline in outlines]).reshape(-1, 3)
    reach = np.array(
        [
            math.sqrt(np.square(outline - centre).sum(axis=1).max())
            for outline, centre in zip(outlines, centres, strict=True)
        ]
    )
    # No two outlines come closer than this.
    bounds = cdist(centres, centres) - reach - reach[:, None]
    limits = np.array([dent.kind == 'dent' for dent in dents], bool)
    bounds[:, ~limits] = math.inf
    np.fill_diagonal(bounds, math.inf)

    @cache
    def apart(one: int, other: int) -> float:
        return math.sqrt(cdist(outlines[one], outlines[other], 'sqeuclidean').min())

    result = []
    for index, (dent, bound) in enumerate(zip(dents, bounds, strict=True)):
        nearest = math.inf
        for other in np.argsort(bound):
            if bound[other] >= nearest:
                break
            nearest = min(nearest, apart(*sorted((index, int(other)))))
        result.append(replace(dent, clearance=nearest))
    return tuple(result)
