"""The skin in the light of the projector, without the fringes: an image that lies on the cloud.

Where a cloud is known, so is the phase of its fringes. Window by window the photograph is then
``level (1 + contrast F(phase))``, and what a pixel shows beside that is the skin's own: paint,
rivets, dirt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, smoothed
from ftp_dent_ros.profilometry.fringe_model.waveform import Waveform
from ftp_dent_ros.profilometry.phase_geometry import PhaseGeometry
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.robust import median

# Of what a point's own light shows, grid points; and the square of the light, by that of the mean,
# at which this counts half: noise and what is left of the fringes are about 3 % of the light,
# marks 10 %.
_OWN, _HALF = 0.5, 0.1
# Standard deviation of the Gaussian before every n-th pixel is taken, n pixels.
_SHARP = 0.4
# To divide by where there is no light: of single precision.
_LEAST = np.finfo(np.float32).eps


@dataclass(frozen=True, eq=False)
class SkinImager:
    """Images of the skin in the grid of a rig's clouds.

    Attributes
    ----------
    geometry : PhaseGeometry
        Of the grid.
    waveform : Waveform
    stride : int
        The grid has every `stride`-th pixel.
    """

    geometry: PhaseGeometry
    waveform: Waveform
    stride: int

    @classmethod
    @lru_cache(maxsize=2)
    def of(cls, rig: Rig, pattern: Pattern, stride: int) -> SkinImager:
        """Imager for a grid; the last ones are kept."""
        columns, rows = (
            np.arange(0.0, size, stride) for size in (rig.camera.width, rig.camera.height)
        )
        geometry = PhaseGeometry.of(rig, pattern, columns, rows)
        return cls(geometry, Waveform.of(pattern), stride)

    def image(
        self, photograph: Photograph, cloud: Cloud, waveform: Waveform | None = None
    ) -> NDArray[np.uint8]:
        """Skin as it would look in the light of the brightest fringe, everywhere.

        Parameters
        ----------
        photograph : Photograph
        cloud : Cloud
            Of it, in the camera's frame, on this grid.
        waveform : Waveform, optional
            As the photograph shows it; otherwise in a usual blur.

        Returns
        -------
        ndarray, shape (rows, columns), uint8
            0 where the cloud has no point.
        """
        known = cloud.valid
        if not known.any():
            return np.zeros(known.shape, np.uint8)
        depth = np.where(known, cloud.points[..., 2], np.float32(1))
        phase = self.geometry.phase(np.reciprocal(depth, dtype=np.float32))
        few = known[::8]  # these rows show how far fringes are apart
        steps = np.abs(np.diff(phase[::8], axis=1))[few[:, 1:] & few[:, :-1]]
        step = median(steps) if steps.size else WIDTH * math.tau
        wide = WIDTH * math.tau / step
        light = self._light(photograph, phase, known, wide)

        waveform = waveform or self.waveform
        if self.stride > 1:
            waveform = waveform.in_blur(waveform.variance + (_SHARP * step) ** 2)
        weight = known.astype(np.float32)
        level, model = _modelled(light, weight, waveform.at(phase)[0], wide)
        model *= weight
        rest = _blurred(model * (light - level * model), _OWN)
        skin = level + rest / (_blurred(model * model, _OWN) + np.float32(_HALF))
        # Twice the mean level is the brightest fringe's; 1 is the darkest skin.
        grey = np.clip(np.rint(2 * skin), 1, 255)
        return np.where(known, grey, 0).astype(np.uint8)

    def _light(
        self,
        photograph: Photograph,
        phase: NDArray[np.float32],
        known: NDArray[np.bool_],
        wide: float,
    ) -> NDArray[np.float32]:
        """Grey levels at the grid's points; in the stripe, red ones as bright as those around."""
        rgb: Any = photograph.rgb()
        unit = np.float32(photograph.unit)
        grey = unit * self._sampled(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
        if self.geometry.pattern.code != 'stripe':
            return grey
        red = unit * self._sampled(cv2.extractChannel(rgb, 0))
        stripe = np.abs(phase) < math.tau  # and what its blur takes of green and blue
        beside = known & ~stripe
        ratio = _blurred(beside * grey, 2 * wide) / np.maximum(
            _blurred(beside * red, 2 * wide), _LEAST
        )
        return np.where(stripe, ratio * red, grey)

    def _sampled(self, plane: Any) -> NDArray[np.float32]:
        """The grid's points of a plane, as sharp as the grid can hold."""
        if self.stride > 1:
            plane = cv2.GaussianBlur(plane, (0, 0), _SHARP * self.stride)
        return plane[:: self.stride, :: self.stride].astype(np.float32)


def _modelled(
    light: NDArray[np.float32],
    weight: NDArray[np.float32],
    fringes: NDArray[np.float32],
    wide: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Level, and the fringes over it, by least squares in Gaussian windows."""
    seen = weight * fringes
    n, c, cc, s, sc = (
        _blurred(each, wide)
        for each in (weight, seen, seen * fringes, weight * light, seen * light)
    )
    inverse = 1 / np.maximum(n * cc - c * c, _LEAST)
    level = np.maximum((s * cc - sc * c) * inverse, _LEAST)
    contrast = np.clip((sc * n - s * c) * inverse / level, 0, 1)
    return level, 1 + contrast * fringes


def _blurred(plane: NDArray, wide: float) -> Any:
    """Gaussian means; what is outside is zero. Wide ones see no more on a coarser grid."""
    return smoothed(plane.astype(np.float32, copy=False), (wide, wide), 2 * [max(int(wide), 1)])
