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
from ftp_dent_ros.robust import median

# Root mean square of a Gaussian dent's Laplacian over its footprint, in depths / width^2.
_BENT = math.sqrt(8) * TENTH
# Times the median noise of a dent beyond which it is a mark's: of half of the dents without one
# none of it is beyond 1.6. With 1 hail on dirt was told 5 % too shallow, with 1.5 no more than
# before; with 2 a scratched dent stayed too deep by 2.6 of what is stated.
_OWN = 1.5

Mask = NDArray[np.bool_]


def weighted(patch: Patch, own: Mask, candidate: Candidate, around: Surroundings) -> Patch:
    """The most probable surface of a dent with a mark in it, beside which depths are known worse.

    It departs from the patch as its noise lets it and bends as a Gaussian dent does, both normally
    distributed: the sum over all cells of (departure / noise)^2 + (Laplacian / the dent's)^2 is
    least. Only noise beyond what a dent has by itself counts. All else stays as it is:
    a valley may be sharp, and gaps are bridged with doubts of their own.

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
    beyond = np.square(patch.told) - (_OWN * median(patch.told[sure])) ** 2
    bent = _BENT * candidate.height * (patch.step / candidate.width) ** 2
    softness = np.where(patch.known, np.maximum(beyond, 0.0), 0.0) / bent**2
    return replace(patch, depth=soft_plate(patch.depth, patch.known, softness))
