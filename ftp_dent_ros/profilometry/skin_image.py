"""The skin in the light of the projector, without the fringes: an image that lies on the cloud.

Where a cloud is known, so is the phase of its fringes. Window by window the photograph is then
``level + modulation cos(phase)``, and what a pixel shows beside that is the skin's own: paint,
rivets, dirt.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.photograph import Photograph
from ftp_dent_ros.profilometry.least_squares.phase_geometry import PhaseGeometry
from ftp_dent_ros.rig import Rig

# Gaussian windows, standard deviations in fringes: of level and modulation; and of the skin, along
# u, where a dark fringe hides it and the bright ones beside it must show it.
_WIDE, _NARROW = 0.7, 0.5
# Of the skin along v, grid points: what nearest points of a grid hold.
_ALONG = 1.0
# Of what a point's own light shows beside that, grid points; and the square of the light, by that
# of the mean, at which this counts half: noise and what is left of the fringes are about 3 % of
# the light, marks 10 %. Without it a mark lies where the nearest bright fringe is, which moves
# with the camera.
_OWN, _HALF = 0.5, 0.1
# Phase up to which green and blue are missing, and a little of their blur, radians.
_STRIPE = np.pi + 0.9
# Of the stripe's surroundings, fringes.
_BESIDE = 3
# Determinant of the normal equations by that of whole fringes, from which on both are told.
_LEAST_TOLD = 0.2
# Modulation over level can be no more; and the least share of a window that is measured.
_WHOLE, _LEAST_SHARE = 1.0, 0.05
# Grey levels: 1 is the darkest skin, 0 no skin. Twice the mean level is the brightest fringe's.
_BRIGHTEST, _LEAST = 2.0, 1e-6


@dataclass(frozen=True, eq=False)
class SkinImager:
    """Images of the skin in the grid of a rig's clouds.

    Attributes
    ----------
    geometry : PhaseGeometry
        Of the grid.
    stride : int
        The grid has every `stride`-th pixel.
    """

    geometry: PhaseGeometry
    stride: int

    @classmethod
    @lru_cache(maxsize=2)
    def of(cls, rig: Rig, pattern: Pattern, stride: int) -> SkinImager:
        """Imager for a grid; the last ones are kept."""
        columns, rows = (
            np.arange(0.0, size, stride) for size in (rig.camera.width, rig.camera.height)
        )
        return cls(PhaseGeometry.of(rig, pattern, columns, rows), stride)

    def image(self, photograph: Photograph, cloud: Cloud) -> NDArray[np.uint8]:
        """Skin as it would look in the light of the brightest fringe, everywhere.

        Parameters
        ----------
        photograph : Photograph
        cloud : Cloud
            Of it, in the camera's frame, on this grid.

        Returns
        -------
        ndarray, shape (rows, columns), uint8
            0 where the cloud has no point.
        """
        known = cloud.valid
        share = known.astype(np.float32)
        depth = np.where(known, cloud.points[..., 2], np.float32(1))
        phase = self.geometry.phase(np.reciprocal(depth, dtype=np.float32))
        period = self._period(phase, known)
        light = self._light(photograph, phase, known, period)
        cosine = self.geometry.pattern.contrast(phase) * np.cos(phase)
        wide = _WIDE * period
        weighted = share * light
        sums = (share, share * cosine, share * cosine * cosine, weighted, weighted * cosine)
        n, c, cc, s, sc = (_blurred(each, wide, wide) for each in sums)
        determinant = n * cc - c * c
        told = determinant > _LEAST_TOLD / 2 * n * n
        safe = np.where(told, determinant, 1)
        level = np.where(told, (s * cc - sc * c) / safe, s / np.maximum(n, _LEAST_SHARE))
        modulation = np.where(told, (sc * n - s * c) / safe, 0)
        contrast = np.clip(modulation / np.maximum(level, _LEAST), 0, _WHOLE)
        model = share * (1 + contrast * cosine)
        along_u, along_v = _NARROW * period, _ALONG
        seen = _blurred(model * light, along_u, along_v)
        skin = seen / np.maximum(_blurred(model * model, along_u, along_v), _LEAST)
        rest = _blurred(model * (light - model * skin), _OWN, _OWN)
        skin += rest / (_blurred(model * model, _OWN, _OWN) + np.float32(_HALF))
        grey = np.clip(np.rint(_BRIGHTEST * skin), 1, 255)
        return np.where(known, grey, 0).astype(np.uint8)

    def _period(self, phase: NDArray[np.float32], known: NDArray[np.bool_]) -> float:
        """Grid points a fringe, of most of the cloud."""
        both = known[::4, 1:] & known[::4, :-1]
        slope = np.abs(np.diff(phase[::4], axis=1)[both])
        return float(2 * np.pi / max(np.median(slope), 1e-3)) if len(slope) else 4.0

    def _light(
        self,
        photograph: Photograph,
        phase: NDArray[np.float32],
        known: NDArray[np.bool_],
        period: float,
    ) -> NDArray[np.float32]:
        """Grey levels at the grid's points; in the stripe, red ones as bright as those around."""
        grid = slice(None, None, self.stride)
        # As sharp as the grid can hold.
        blur = 0.4 * self.stride if self.stride > 1 else 0.0

        def sampled(plane: Any) -> NDArray[np.float32]:
            smooth = cv2.GaussianBlur(plane, (0, 0), blur) if blur else plane
            return smooth[grid, grid].astype(np.float32)

        rgb = photograph.rgb()
        light = np.float32(photograph.unit) * sampled(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
        if self.geometry.pattern.code != 'stripe':
            return light
        stripe = (np.abs(phase) < _STRIPE) & known
        columns = np.flatnonzero(stripe.any(axis=0))
        if not len(columns):
            return light
        beside = int(np.ceil(_BESIDE * period))
        band = (slice(None), slice(max(columns[0] - beside, 0), columns[-1] + beside + 1))
        red = np.float32(photograph.unit) * sampled(cv2.extractChannel(rgb, 0))[band]
        weight = (known[band] & ~stripe[band]).astype(np.float32)
        ratio = _blurred(weight * light[band], period, period) / np.maximum(
            _blurred(weight * red, period, period), _LEAST
        )
        light[band] = np.where(stripe[band], ratio * red, light[band])
        return light


def _blurred(plane: NDArray, along_u: float, along_v: float) -> Any:
    return cv2.GaussianBlur(
        plane.astype(np.float32), (0, 0), along_u, sigmaY=along_v, borderType=cv2.BORDER_CONSTANT
    )
