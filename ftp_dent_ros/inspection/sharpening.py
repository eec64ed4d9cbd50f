"""A dent's depths, corrected with its fitted model for what the reconstruction does to them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.blurring import Grid
from ftp_dent_ros.inspection.model import FittedDents
from ftp_dent_ros.inspection.patch import Patch

# The model corrects for the blur if it leaves less than this part of the depth.
_EXPLAINED = 0.05
# Part of the evident correction that the deepest place takes.
_AT_BOTTOM = 0.5
# Standard uncertainty of such corrections, as a part of them.
_DOUBT = 0.3
# What differs from the model by more than this part of the depth, and the noise, is an artefact.
_STRAYS = 0.02

Field = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sharpened:
    """Depths around one dent, without its neighbours; arrays of shape (rows, columns), metres.

    Attributes
    ----------
    patch : Patch
        Without the blur.
    model : ndarray
        Depth of the dent's model; 0 if it does not explain the patch.
    explained : bool
        Whether it does.
    doubted : ndarray
        Standard uncertainty of the correction.
    unsure : ndarray
        Part of the correction that edges need, and the deepest place does not: the reconstruction
        blurs a dent's rim more than its bottom.
    """

    patch: Patch
    model: Field
    explained: bool
    doubted: Field
    unsure: Field


def sharpened(raw: Patch, fitted: FittedDents, spread: float) -> list[Sharpened]:
    """Correct the depths around each of the dents that were fitted together.

    Parameters
    ----------
    raw : Patch
    fitted : FittedDents
    spread : float
        Standard deviation of the patch's depths, metres.
    """
    grid = Grid(raw.x, raw.y)
    blurred = [fitted.blurred(index, grid) for index in range(len(fitted.dents))]
    result = []
    for dent, seen in zip(fitted.dents, blurred, strict=True):
        alone = raw.depth - (sum(blurred) - seen)
        deepest = dent.parameters[5]
        if fitted.left < _EXPLAINED * deepest:
            model = dent.depth(grid.x, grid.y)
            # Fringes too oblique or too bright leave ripples beyond noise and shape.
            most = max(3 * spread, _STRAYS * deepest)
            left = alone - seen
            kept = np.clip(left, -most, most)
            change = model - seen
            unsure = (1 - _AT_BOTTOM * fitted.evidence) * change
            share = math.hypot(_DOUBT, 1 - fitted.evidence)
            doubted = np.hypot(share * change, _DOUBT * (left - kept))
            patch = _with(raw, model + kept)
            result.append(Sharpened(patch, model, True, doubted, unsure))
        else:
            none = np.zeros_like(alone)
            result.append(Sharpened(_with(raw, alone), none, False, none, none))
    return result


def _with(raw: Patch, depth: Field) -> Patch:
    return replace(raw, depth=np.where(raw.known, depth, 0.0))
