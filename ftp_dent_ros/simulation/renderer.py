"""Photographs of a surface in the projector's light, by physics alone.

The renderer knows of the reconstruction only what a rig is. Each pixel gathers light at points
spread over its area and over the exposure: a few where what it sees is smooth, more elsewhere.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.rig import Rig
from ftp_dent_ros.simulation.light import Light
from ftp_dent_ros.simulation.motion import Motion
from ftp_dent_ros.simulation.photometry import Photometry
from ftp_dent_ros.simulation.sensor import expose, speckle
from ftp_dent_ros.simulation.surface import Surface
from ftp_dent_ros.simulation.tracing import View, albedo_table, look
from ftp_dent_ros.simulation.view import (
    broken_pixels,
    image_sweep,
    light_drift,
    pixel_grid,
    see,
    visible_part,
)

# Generators of a rank-1 lattice over (column, row, time): evenly spread in each of them alone
# and in the sums of them along which moving fringes run.
_LATTICE = (1, 19, 53)

# Longest way of the image, pixels, over which one set of points integrates a moving fringe.
_INTERVAL = 2.0

Image = NDArray[Any]


class Renderer:
    """A camera and a projector that shows one image.

    Building one prepares the projector's light; `render` then is quick.

    Parameters
    ----------
    rig : Rig
    projected : ndarray, shape (projector height, projector width, 3), uint8
        The projected image, RGB.
    photometry : Photometry

    Raises
    ------
    ImageError
        The projected image is not the projector's size or type.
    """

    def __init__(
        self, rig: Rig, projected: NDArray[np.uint8], photometry: Photometry | None = None
    ) -> None:
        expected = (rig.projector.height, rig.projector.width, 3)
        if projected.shape != expected or projected.dtype != np.uint8:
            raise ImageError(
                f'the projected image is {projected.dtype} of shape {projected.shape}, the '
                f"projector's uint8 of shape {expected}: project an RGB image of its size"
            )
        self.rig = rig
        self.photometry = photometry or Photometry()
        self._light = Light(projected, self.photometry)
        self._points = _lattice(self.photometry.samples)

    def render(
        self,
        surface: Surface,
        rng: np.random.Generator | None = None,
        motion: Motion | None = None,
    ) -> NDArray[np.uint8]:
        """Photograph a surface.

        Parameters
        ----------
        surface : Surface
            In the camera's optical frame, in mid-exposure.
        rng : numpy.random.Generator, optional
            Of the noise; seeded with 0 if left out.
        motion : Motion, optional
            Of the surface during the exposure.

        Returns
        -------
        ndarray, shape (camera height, camera width, 3), uint8
            RGB.
        """
        rng = rng or np.random.default_rng(0)
        lit, albedo = self._gather(surface, rng, motion or Motion())
        if self.photometry.speckle_contrast:
            lit *= speckle(lit.shape, self.photometry, rng)
        albedo *= self.photometry.ambient
        lit += albedo
        gain = np.float32(self.photometry.exposure)
        lit *= gain * pixel_grid(self.rig.camera).vignette if self.photometry.shading else gain
        return expose(lit, self.photometry, rng)

    def _gather(
        self, surface: Surface, rng: np.random.Generator, motion: Motion
    ) -> tuple[Image, Image]:
        """Projected light off the skin, and the skin's albedo, each (3, height, width)."""
        surface = visible_part(self.rig, surface)
        view = see(self.rig, surface, self.photometry)
        if self.photometry.phase_noise_px:
            view.u += rng.normal(0, self.photometry.phase_noise_px, view.u.shape)
        sweep = image_sweep(self.rig, surface, motion)
        lit = self._smooth_light(surface, view, motion, sweep)
        albedo: Image = np.stack([cv2.LUT(view.tone, tone) for tone in albedo_table(surface)])
        for channel, tone in zip(lit, albedo, strict=True):
            channel *= tone * view.diffuse + view.specular
        for pixels in broken_pixels(self.rig, surface, view, sweep):
            at = (slice(None), *np.divmod(pixels, view.u.shape[1]))
            lit[at], albedo[at] = self._fine_light(surface, motion, pixels, rng)
        return lit, albedo

    def _smooth_light(self, surface: Surface, view: View, motion: Motion, sweep: float) -> Image:
        """Mean light that falls on what each pixel sees, (3, height, width).

        What is seen changes evenly over a pixel's area and over the exposure, during which the
        image moves by `sweep` pixels.
        """
        light = self._light
        position = light.index(view.u, view.v)
        slopes = [np.gradient(position, axis=2), np.gradient(position, axis=1)]
        if motion:
            slopes.append(light.index_change(light_drift(self.rig, surface, view, motion)))
        points = _cubature(len(slopes), math.ceil(sweep / _INTERVAL))
        total = np.zeros((*view.u.shape, 4), np.float32)
        for point in points:
            column, row = position
            for axis in np.flatnonzero(point):
                column = cv2.scaleAdd(slopes[axis][0], point[axis], column)
                row = cv2.scaleAdd(slopes[axis][1], point[axis], row)
            light.add(total, column, row)
        return light.mean(total, len(points))

    def _fine_light(
        self,
        surface: Surface,
        motion: Motion,
        pixels: NDArray[np.intp],
        rng: np.random.Generator,
    ) -> tuple[Image, Image]:
        """Projected light off the skin and its albedo at pixels of shape (n,), each (3, n)."""
        along_u, along_v, moments = self._points.T
        directions = pixel_grid(self.rig.camera).rays_within(pixels, along_u, along_v)
        fine = look(self.rig, surface, motion.rays(directions, moments), self.photometry)
        shape = len(pixels), len(moments)
        if self.photometry.phase_noise_px:
            noise = rng.normal(0, self.photometry.phase_noise_px, len(pixels))
            fine.u += np.broadcast_to(noise[:, None], shape).ravel()
        albedo = albedo_table(surface)[:, fine.tone]
        light = self._light.at(fine.u, fine.v) * (albedo * fine.diffuse + fine.specular)
        return light.reshape(3, *shape).mean(axis=2), albedo.reshape(3, *shape).mean(axis=2)


def render(
    rig: Rig,
    projected: NDArray[np.uint8],
    surface: Surface,
    photometry: Photometry | None = None,
    rng: np.random.Generator | None = None,
    motion: Motion | None = None,
) -> NDArray[np.uint8]:
    """Photograph a surface once: see `Renderer`, which is quicker for more of them."""
    return Renderer(rig, projected, photometry).render(surface, rng, motion)


def _cubature(dimensions: int, intervals: int) -> NDArray[np.float64]:
    """Points (column, row[, time]) from -1/2 to 1/2 whose mean integrates cubic polynomials.

    On each axis two points, so far out that the variance is right; time in a few intervals.
    """
    star = math.sqrt(dimensions / 12) * np.vstack([np.eye(dimensions), -np.eye(dimensions)])
    if dimensions < 3:
        return star
    star[:, 2] /= intervals
    centres = np.zeros((intervals, 1, 3))
    centres[:, 0, 2] = (np.arange(intervals) + 0.5) / intervals - 0.5
    return (centres + star).reshape(-1, 3)


def _lattice(count: int) -> NDArray[np.float64]:
    """Points (column, row, time) from -1/2 to 1/2, symmetric about 0, shape (count, 3)."""
    odd = 2 * np.arange(count) + 1
    return (np.outer(odd, _LATTICE) % (2 * count)) / (2 * count) - 0.5
