"""Patches that are kept for later passes, in a tenth of the memory."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.patch import Patch

# Least step of heights, metres: a quarter of what no pair is better than.
_STEP = 2.5e-7
# Steps either way, and what stands for no height.
_MOST, _NONE = 32000, -32768
# Cells a side that share one uncertainty.
_SHARED = 4


@dataclass(frozen=True, eq=False)
class FoldedPatch:
    """A patch in small numbers.

    Attributes
    ----------
    frame, pitch, corner
        As the patch's.
    steps : ndarray, shape (rows, columns), int16
        Heights from the middle one on.
    middle, step : float
        Metres.
    sigma : ndarray, shape (rows / 4, columns / 4), float16
        Millimetres.
    light : ndarray, shape (rows, columns), float16, or None
    level : float
        That is added to the light.
    """

    frame: Pose
    pitch: float
    corner: NDArray[np.float64]
    steps: NDArray[np.int16]
    middle: float
    step: float
    sigma: NDArray[np.float16]
    light: NDArray[np.float16] | None
    level: float

    @classmethod
    def of(cls, patch: Patch) -> FoldedPatch:
        """Fold a patch."""
        known = np.isfinite(patch.height)
        low, high = float(patch.height[known].min()), float(patch.height[known].max())
        middle, step = (low + high) / 2, max(_STEP, (high - low) / 2 / _MOST)
        steps = np.rint(np.where(known, (patch.height - middle) / step, _NONE))
        light, level = None, 0.0
        if patch.light is not None:
            level = float(np.nanmean(patch.light))
            light = (patch.light - level).astype(np.float16)
        sigma = patch.sigma[::_SHARED, ::_SHARED]
        # Beside the rim, where heights end and not their uncertainty.
        sigma = np.where(np.isfinite(sigma), sigma, np.nanmax(sigma))
        return cls(
            patch.frame,
            patch.pitch,
            patch.corner,
            steps.astype(np.int16),
            middle,
            step,
            sigma.astype(np.float16),
            light,
            level,
        )

    @lru_cache(maxsize=8)  # noqa: B019 - the last that were used, with their layers, on purpose
    def unfolded(self) -> Patch:
        """The patch; the last ones are kept."""
        known = self.steps != _NONE
        height = np.where(known, self.middle + self.step * self.steps.astype(float), np.nan)
        rows, columns = self.steps.shape
        sigma = np.repeat(np.repeat(self.sigma, _SHARED, axis=0), _SHARED, axis=1)
        light = None
        if self.light is not None:
            light = self.light.astype(np.float32) + np.float32(self.level)
        return Patch(
            self.frame,
            self.pitch,
            self.corner,
            height.astype(np.float32),
            sigma[:rows, :columns].astype(np.float32),
            light,
        )


@dataclass(frozen=True, eq=False)
class Kept:
    """A patch that clouds to come may be laid on, whole or folded, and its lesser side, metres."""

    whole: Patch | FoldedPatch
    size: float

    @property
    def patch(self) -> Patch:
        """The patch."""
        return self.whole if isinstance(self.whole, Patch) else self.whole.unfolded()

    def folded(self) -> Kept:
        """The same in less memory."""
        return Kept(FoldedPatch.of(self.patch), self.size)
