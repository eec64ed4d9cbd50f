"""Depths weighed by how well each is known: of a dent with a mark in it the rest tells more."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.places.detection import Candidate
from ftp_dent_ros.inspection.measuring.places.evidence import TENTH
from ftp_dent_ros.inspection.measuring.places.kinds import LONG
from ftp_dent_ros.inspection.measuring.places.surroundings import Surroundings
from ftp_dent_ros.inspection.measuring.skin.filling import soft_plate
from ftp_dent_ros.median import median

# Root mean square of a Gaussian dent's Laplacian over its footprint, in depths / width^2.
_BENT = math.sqrt(8) * TENTH

Mask = NDArray[np.bool_]


def weighted(patch: Patch, own: Mask, candidate: Candidate, around: Surroundings) -> Patch:
    """The most probable surface of a dent with a mark in it, beside which depths are known worse.

    It departs from the patch as its noise lets it and bends as a Gaussian dent does, both normally
    distributed: the sum over all cells of (departure / noise)^2 + (Laplacian / the dent's)^2 is
    least. Only noise beyond the median of the dent counts. All else stays as it is: what has no
    mark is in doubt where it bends; a valley may be sharp; gaps are bridged with doubts of their
    own.

    Parameters
    ----------
    patch : Patch
    own : ndarray, shape (rows, columns), bool
        Cells that are the candidate's.
    candidate : Candidate
        Tells how deep and wide the dent is.
    around : Surroundings
    """
    sure = own & patch.known
    is_valley = candidate.length > LONG * candidate.width
    if not around.is_marked or is_valley or candidate.gap.size or not sure.any():
        return patch
    beyond = np.square(patch.told) - median(patch.told[sure]) ** 2
    bent = _BENT * candidate.height * (patch.step / candidate.width) ** 2
    softness = np.where(patch.known, np.maximum(beyond, 0.0), 0.0) / bent**2
    return replace(patch, depth=soft_plate(patch.depth, patch.known, softness))
