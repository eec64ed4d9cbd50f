"""The distance from each dent's outline to the next dent's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from ftp_dent_ros.inspection.dent import MeasuredDent


def with_clearances(dents: Sequence[MeasuredDent]) -> tuple[MeasuredDent, ...]:
    """The same, each with its clearance to the nearest of kind ``'dent'``."""
    outlines = [d.outline if len(d.outline) else d.position[None] for d in dents]
    centres = np.array([outline.mean(axis=0) for outline in outlines]).reshape(-1, 3)
    reach = np.array(
        [
            np.linalg.norm(outline - centre, axis=1).max()
            for outline, centre in zip(outlines, centres, strict=True)
        ]
    )
    result = []
    for index, dent in enumerate(dents):
        # No outline comes closer than this.
        bounds = np.linalg.norm(centres - centres[index], axis=1) - reach - reach[index]
        nearest = math.inf
        for other in np.argsort(bounds):
            if bounds[other] >= nearest:
                break
            if other != index and dents[other].kind == 'dent':
                nearest = min(nearest, float(cdist(outlines[index], outlines[other]).min()))
        result.append(replace(dent, clearance=nearest))
    return tuple(result)
