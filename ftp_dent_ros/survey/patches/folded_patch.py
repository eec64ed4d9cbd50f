"""Patches that are kept for later passes, in a twentieth of the memory."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.patches.patch import Patch

# Least step of heights, metres: a quarter of what no pair is better than.
_STEP = 2.5e-7
# Of the logarithm of light: a tenth of a skin image's noise.
_LIGHT_STEP = 5e-4
# Steps either way, and what stands for nothing.
_MOST, _NONE = 32000, -32768
# Of zlib: the quickest.
_LEVEL = 1
# Cells a side that share one uncertainty.
_SHARED = 4


@dataclass(frozen=True, eq=False)
class FoldedPatch:
    """A patch in small numbers.

    Attributes
    ----------
    frame, pitch, corner
        As the patch's.
    shape : tuple of 2 ints
        Rows and columns.
    steps : bytes
        Heights from the middle one on, packed.
    middle, step : float
        Metres.
    sigma : ndarray, shape (rows / 4, columns / 4), float16
        Millimetres.
    light : bytes or None
        Packed.
    level : float
        That is added to the light.
    """

    frame: Pose
    pitch: float
    corner: NDArray[np.float64]
    shape: tuple[int, int]
    steps: bytes
    middle: float
    step: float
    sigma: NDArray[np.float16]
    light: bytes | None
    level: float

    @classmethod
    def of(cls, patch: Patch) -> FoldedPatch:
        """Fold a patch."""
        known = np.isfinite(patch.height)
        low, high = float(patch.height[known].min()), float(patch.height[known].max())
        middle, step = (low + high) / 2, max(_STEP, (high - low) / 2 / _MOST)
        steps = np.where(known, (patch.height - middle) / step, _NONE)
        light, level = None, 0.0
        if patch.light is not None:
            level = float(np.nanmean(patch.light))
            light = np.clip((patch.light - level) / _LIGHT_STEP, -_MOST, _MOST)
            light = _packed(np.where(np.isfinite(light), light, _NONE))
        sigma = patch.sigma[::_SHARED, ::_SHARED]
        # Beside the rim, where heights end and not their uncertainty.
        sigma = np.where(np.isfinite(sigma), sigma, np.nanmax(sigma))
        return cls(
            patch.frame,
            patch.pitch,
            patch.corner,
            (patch.height.shape[0], patch.height.shape[1]),
            _packed(steps),
            middle,
            step,
            sigma.astype(np.float16),
            light,
            level,
        )

    @lru_cache(maxsize=8)  # noqa: B019 - the last that were used, with their layers, on purpose
    def unfolded(self) -> Patch:
        """The patch; the last ones are kept."""
        rows, columns = self.shape
        height = self.middle + self.step * _unpacked(self.steps, self.shape)
        sigma = np.repeat(np.repeat(self.sigma, _SHARED, axis=0), _SHARED, axis=1)
        light = None
        if self.light is not None:
            there = _LIGHT_STEP * _unpacked(self.light, self.shape) + self.level
            light = there.astype(np.float32)
        return Patch(
            self.frame,
            self.pitch,
            self.corner,
            height.astype(np.float32),
            sigma[:rows, :columns].astype(np.float32),
            light,
        )


def _packed(steps: NDArray[np.floating]) -> bytes:
    """Whole numbers that differ little from column to column."""
    whole = np.rint(steps).astype(np.int16)
    return zlib.compress(np.diff(whole, axis=1, prepend=np.int16(0)).tobytes(), _LEVEL)


def _unpacked(packed: bytes, shape: tuple[int, int]) -> NDArray[np.float64]:
    """The numbers, NaN where there was nothing."""
    changes = np.frombuffer(zlib.decompress(packed), np.int16).reshape(shape)
    # Sums that do not fit come round to where they were.
    whole = np.cumsum(changes, axis=1, dtype=np.int16)
    return np.where(whole == _NONE, np.nan, whole.astype(float))


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
