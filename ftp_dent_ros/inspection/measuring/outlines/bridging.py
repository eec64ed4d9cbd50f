"""What lies over places without points, as far as those around them tell."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.outlines.restoration import Restored
from ftp_dent_ros.inspection.measuring.skin.filling import around, membrane, plate
from ftp_dent_ros.inspection.measuring.skin.gaps import gaps_of

# Two cells beside a gap.
_BESIDE = np.ones((5, 5), np.uint8)

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Bridged(Restored):
    """A restored patch whose gaps are filled.

    Attributes
    ----------
    bridged : ndarray, shape (rows, columns), bool
        Cells without points, whose depths the ones around them suggest.
    """

    bridged: Mask

    @cached_property
    def measured(self) -> Patch:
        """The patch without what was filled."""
        return replace(self.patch, known=self.patch.known & ~self.bridged)

    def is_measured_across(self, at: tuple[int, int], angle: float, width: float) -> bool:
        """Whether there are points all across a cell, at an angle from the patch's x axis."""
        patch = self.patch
        along = np.arange(-width / 2, width / 2, patch.step / 2)
        x, y = patch.x[at[1]] + along * math.cos(angle), patch.y[at[0]] + along * math.sin(angle)
        return bool(self.measured.is_known(x, y).all())


def bridged(seen: Restored, reach: float, own: Mask) -> Bridged:
    """Fill a patch where it is not known between known places no more than `reach` metres apart.

    As it is if all is known about the cells `own`.

    A plate carries the slopes on into the gap, a membrane does not, and a plate through points
    farther off carries on those that no edge of light or paint beside the gap has bent: how the
    three differ is the doubt.
    """
    patch = seen.patch
    if not own.any() or patch.known[around(own)].all():
        return Bridged(patch, seen.doubt, np.zeros_like(patch.known))
    over = gaps_of(patch.known, round(reach / patch.step))
    if not over.any():
        return Bridged(patch, seen.doubt, over)
    window = around(over)
    part, free = over[window], ~patch.known[window]
    depth, doubt = patch.depth.copy(), seen.doubt.copy()
    stiff = plate(depth[window], free)
    slack = membrane(depth[window], free)
    farther = plate(depth[window], cv2.dilate(free.view(np.uint8), _BESIDE) > 0)
    filled = np.where(part, stiff, depth[window])
    apart = np.hypot(filled - farther, np.where(part, stiff - slack, 0.0))
    depth[window] = filled
    doubt[window] = np.hypot(membrane(doubt[window], free), apart)
    return Bridged(replace(patch, depth=depth, known=patch.known | over), doubt, over)
