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
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation.photography.drift import image_sweep, light_drift, skin_drift
from ftp_dent_ros.simulation.photography.integration import cubature, lattice, moved, shifted
from ftp_dent_ros.simulation.photography.light import Light
from ftp_dent_ros.simulation.photography.motion import Motion
from ftp_dent_ros.simulation.photography.photometry import Photometry
from ftp_dent_ros.simulation.photography.pixel_grid import pixel_grid
from ftp_dent_ros.simulation.photography.sensor import read_out, speckle
from ftp_dent_ros.simulation.photography.tracing import View, albedo_table, look
from ftp_dent_ros.simulation.photography.view import broken_pixels, see, visible_part
from ftp_dent_ros.simulation.skin.skin import is_even, paint_and_sun, smooth_paint
from ftp_dent_ros.simulation.skin.surface import Surface

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
        self._points = lattice(self.photometry.samples)

    def photograph(
        self,
        surface: Surface,
        rng: np.random.Generator | None = None,
        motion: Motion | None = None,
    ) -> Photograph:
        """Photograph a surface, in the encoding of the photometry.

        Parameters
        ----------
        surface : Surface
            In the camera's optical frame, in mid-exposure.
        rng : numpy.random.Generator, optional
            Of the noise; seeded with 0 if left out.
        motion : Motion, optional
            Of the surface during the exposure.
        """
        rng = rng or np.random.default_rng(0)
        return read_out(self.signal(surface, rng, motion), self.photometry, rng)

    def render(
        self,
        surface: Surface,
        rng: np.random.Generator | None = None,
        motion: Motion | None = None,
    ) -> NDArray[np.uint8]:
        """RGB of 8 bits, shape (camera height, camera width, 3), of such a photograph."""
        return self.photograph(surface, rng, motion).shown()

    def signal(
        self,
        surface: Surface,
        rng: np.random.Generator | None = None,
        motion: Motion | None = None,
    ) -> Image:
        """Light on the sensor, before the lens's blur, noise and saturation.

        Parameters are those of `photograph`.

        Returns
        -------
        ndarray, shape (3, camera height, camera width), float32
            1 saturates.
        """
        rng = rng or np.random.default_rng(0)
        lit, ambient = self._gather(surface, rng, motion or Motion())
        if self.photometry.speckle_contrast:
            lit *= speckle(lit.shape, self.photometry, rng)
        lit += ambient
        gain = np.float32(self.photometry.exposure)
        lit *= gain * pixel_grid(self.rig.camera).vignette if self.photometry.shading else gain
        return lit

    def _gather(
        self, surface: Surface, rng: np.random.Generator, motion: Motion
    ) -> tuple[Image, Image]:
        """The projector's and all other light off the skin, each (3, height, width)."""
        surface = visible_part(self.rig, surface)
        view = see(self.rig, surface, self.photometry)
        if self.photometry.phase_noise_px:
            view.u += rng.normal(0, self.photometry.phase_noise_px, view.u.shape)
        sweep = image_sweep(self.rig, surface, motion)
        if is_even(surface):
            lit, ambient = self._even_skin(surface, view, motion, sweep)
        else:
            lit, ambient = self._marked_skin(surface, view, motion)
        for pixels in broken_pixels(self.rig, surface, view, sweep):
            at = (slice(None), *np.divmod(pixels, view.u.shape[1]))
            lit[at], ambient[at] = self._broken_skin(surface, motion, pixels, rng)
        return lit, ambient

    def _even_skin(
        self, surface: Surface, view: View, motion: Motion, sweep: float
    ) -> tuple[Image, Image]:
        """Light off a skin without marks, which changes evenly over a pixel and the exposure.

        The image moves by `sweep` pixels during the exposure.
        """
        light = self._light
        place, slopes = self._positions(surface, view, motion)
        points = cubature(len(slopes), math.ceil(sweep / _INTERVAL))
        total = np.zeros((*view.u.shape, 4), np.float32)
        for point in points:
            light.add(total, *moved(place, slopes, point))
        lit = light.mean(total, len(points))
        ambient: Image = np.stack([cv2.LUT(view.tone, tone) for tone in albedo_table(surface)])
        ambient *= view.clean
        for channel, albedo in zip(lit, ambient, strict=True):
            channel *= albedo * view.diffuse + view.specular
        ambient *= np.float32(self.photometry.ambient)
        return lit, ambient

    def _marked_skin(self, surface: Surface, view: View, motion: Motion) -> tuple[Image, Image]:
        """Light off a skin whose marks may end anywhere within a pixel."""
        light = self._light
        place, slopes = self._positions(surface, view, motion)
        # On the panel in float32: to a thousandth of a pixel.
        skin = np.stack([view.x, view.y]).astype(np.float32)
        skin_slopes = [np.gradient(skin, axis=2), np.gradient(skin, axis=1)]
        if motion:
            skin_slopes.append(skin_drift(self.rig, surface, view, motion))
        smooth = smooth_paint(surface, view.tone, *skin)
        smooth_slopes = [np.gradient(smooth, axis=1), np.gradient(smooth, axis=0)]
        if motion:
            half = skin_slopes[2] / 2
            before, after = (
                smooth_paint(surface, view.tone, *end) for end in (skin - half, skin + half)
            )
            smooth_slopes.append(after - before)
        plain = np.zeros((*view.u.shape, 4), np.float32)
        diffuse = np.zeros((3, *view.u.shape), np.float32)
        ambient = np.zeros_like(diffuse)
        for point in self._points[:, : len(slopes)]:
            sample = light.sample(*moved(place, slopes, point))
            here = moved(skin, skin_slopes, point)
            paint, sun = paint_and_sun(surface, view.tone, *here, sharp_only=True)
            paint *= shifted(smooth, smooth_slopes, point)
            sun += np.float32(self.photometry.ambient)
            cv2.accumulate(sample, plain)
            for channel in range(3):
                factor = paint[channel % len(paint)]
                diffuse[channel] += sample[..., channel] * factor
                ambient[channel] += sun * factor
        diffuse *= light.unit / np.float32(len(self._points))
        ambient /= len(self._points)
        lit = light.mean(plain, len(self._points))
        lit *= view.specular
        for channel, tone in enumerate(albedo_table(surface)):
            albedo = cv2.LUT(view.tone, tone) * view.clean
            lit[channel] += diffuse[channel] * albedo * view.diffuse
            ambient[channel] *= albedo
        return lit, ambient

    def _positions(
        self, surface: Surface, view: View, motion: Motion
    ) -> tuple[Image, list[Image]]:
        """Indices into the light, and their change over a pixel's columns, rows, and time."""
        position = self._light.index(view.u, view.v)
        slopes = [np.gradient(position, axis=2), np.gradient(position, axis=1)]
        if motion:
            drift = light_drift(self.rig, surface, view, motion)
            slopes.append(self._light.index_change(drift))
        return position, slopes

    def _broken_skin(
        self,
        surface: Surface,
        motion: Motion,
        pixels: NDArray[np.intp],
        rng: np.random.Generator,
    ) -> tuple[Image, Image]:
        """The projector's and all other light off the skin at pixels (n,), each (3, n)."""
        along_u, along_v, moments = self._points.T
        directions = pixel_grid(self.rig.camera).rays_within(pixels, along_u, along_v)
        fine = look(self.rig, surface, motion.rays(directions, moments), self.photometry)
        shape = len(pixels), len(moments)
        if self.photometry.phase_noise_px:
            noise = rng.normal(0, self.photometry.phase_noise_px, len(pixels))
            fine.u += np.broadcast_to(noise[:, None], shape).ravel()
        paint, sun = paint_and_sun(surface, fine.tone, fine.x, fine.y)
        albedo = albedo_table(surface)[:, fine.tone] * paint * fine.clean
        light = self._light.at(fine.u, fine.v) * (albedo * fine.diffuse + fine.specular)
        ambient = albedo * (self.photometry.ambient + sun)
        return light.reshape(3, *shape).mean(axis=2), ambient.reshape(3, *shape).mean(axis=2)


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
