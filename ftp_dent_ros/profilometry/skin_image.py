"""The skin in the light of the projector, without the fringes: an image that lies on the cloud.

Where a cloud is known, so is the phase of its fringes. Window by window the photograph is then
``level + modulation cos(phase)``, and what a pixel shows beside that is the skin's own: paint,
rivets, dirt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.fringe_model.waveform import Waveform
from ftp_dent_ros.profilometry.phase_geometry import PhaseGeometry
from ftp_dent_ros.rig.rig import Rig

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
# Determinant of the normal equations by that of whole fringes, from which on both are known.
_LEAST_KNOWN = 0.2
# Modulation over level can be no more; and the least share of a window that is measured.
_WHOLE, _LEAST_SHARE = 1.0, 0.05
# Variances of the blur between which the one that is seen is looked for, radians^2 of phase; rows
# that tell it, about; and the most that a mark's light counts for, by that of the skin.
_BLURS, _ROWS, _OF_MARKS = np.linspace(0.1, 1.7, 5), 32, 0.1
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
        cosine = self._fringes(light, phase, share, period)
        wide = _WIDE * period
        model = share * (1 + _contrast(light, cosine, share, wide, wide)[1] * cosine)
        along_u, along_v = _NARROW * period, _ALONG
        seen = _blurred(model * light, along_u, along_v)
        skin = seen / np.maximum(_blurred(model * model, along_u, along_v), _LEAST)
        rest = _blurred(model * (light - model * skin), _OWN, _OWN)
        skin += rest / (_blurred(model * model, _OWN, _OWN) + np.float32(_HALF))
        grey = np.clip(np.rint(_BRIGHTEST * skin), 1, 255)
        return np.where(known, grey, 0).astype(np.uint8)

    def _fringes(
        self,
        light: NDArray[np.float32],
        phase: NDArray[np.float32],
        share: NDArray[np.float32],
        period: float,
    ) -> NDArray[np.float32]:
        """The fringes as they are seen: of a code, blurred by as much as leaves least of them."""
        if self.geometry.pattern.code == 'stripe':
            return np.cos(phase)
        some = slice(None, None, max(1, len(phase) // _ROWS))
        phases, lights, shares = phase[some], light[some], share[some]
        left = []
        for variance in _BLURS:
            cosine = self._blurred_fringes(phases, variance)
            level, contrast = _contrast(lights, cosine, shares, _WIDE * period, 0)
            rest = lights - level * (1 + contrast * cosine)
            part = np.abs(rest[shares > 0]) / np.maximum(level[shares > 0], _LEAST)
            left.append(float(np.mean(np.minimum(part, _OF_MARKS) ** 2)) if len(part) else 0.0)
        return self._blurred_fringes(phase, _lowest(_BLURS, left))

    def _blurred_fringes(self, phase: NDArray[np.float32], variance: float) -> NDArray[np.float32]:
        fringes, _ = replace(_waveform(self.geometry.pattern), variance=variance).at(phase)
        return fringes

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


def _contrast(
    light: NDArray[np.float32],
    cosine: NDArray[np.float32],
    share: NDArray[np.float32],
    along_u: float,
    along_v: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Level, and the fringes' contrast, in windows."""
    weighted = share * light
    sums = (share, share * cosine, share * cosine * cosine, weighted, weighted * cosine)
    n, c, cc, s, sc = (_blurred(each, along_u, along_v) for each in sums)
    determinant = n * cc - c * c
    known = determinant > _LEAST_KNOWN / 2 * n * n
    safe = np.where(known, determinant, 1)
    level = np.where(known, (s * cc - sc * c) / safe, s / np.maximum(n, _LEAST_SHARE))
    modulation = np.where(known, (sc * n - s * c) / safe, 0)
    return level, np.clip(modulation / np.maximum(level, _LEAST), 0, _WHOLE)


def _lowest(places: NDArray[np.float64], values: list[float]) -> float:
    """Where a parabola through the lowest of some values and its neighbours is lowest."""
    at = min(max(int(np.argmin(values)), 1), len(values) - 2)
    below, here, above = values[at - 1 : at + 2]
    bend = below - 2 * here + above
    step = 0.5 * (below - above) / bend if bend > 0 else 0.0
    return float(places[at] + np.clip(step, -1, 1) * (places[at + 1] - places[at]))


@lru_cache(maxsize=2)
def _waveform(pattern: Pattern) -> Waveform:
    return Waveform.of(pattern)


def _blurred(plane: NDArray, along_u: float, along_v: float) -> Any:
    """Gaussian means, along v only where that is asked for; what is outside is zero."""
    size = (0, 0) if along_v else (2 * round(4 * along_u) + 1, 1)
    plane = plane.astype(np.float32)
    return cv2.GaussianBlur(plane, size, along_u, sigmaY=along_v, borderType=cv2.BORDER_CONSTANT)
