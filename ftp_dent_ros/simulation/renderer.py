"""Photographs of a surface in the projector's light, by physics alone.

The renderer knows of the reconstruction only what a rig is. Each pixel gathers light at points
spread over its area and over the exposure's time.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.rig import Rig
from ftp_dent_ros.simulation.light import Light
from ftp_dent_ros.simulation.photometry import Photometry
from ftp_dent_ros.simulation.sensor import expose, speckle
from ftp_dent_ros.simulation.surface import Surface
from ftp_dent_ros.simulation.tracing import Motion, look, tones
from ftp_dent_ros.simulation.view import (
    broken_pixels,
    image_sweep,
    pixel_grid,
    see,
    visible_part,
)

# Generators of a rank-1 lattice over (column, row, time): evenly spread in each of them alone
# and in the sums of them along which moving fringes run.
_LATTICE = (1, 19, 53)

Image = NDArray[np.float32]


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
        lit, ambient = self._gather(surface, rng, motion or Motion())
        if self.photometry.speckle_contrast:
            lit *= speckle(lit.shape, self.photometry, rng)
        signal = lit + self.photometry.ambient * ambient
        signal *= self.photometry.exposure
        if self.photometry.shading:
            signal *= pixel_grid(self.rig.camera).vignette[..., None]
        return expose(signal, self.photometry, rng)

    def _gather(
        self, surface: Surface, rng: np.random.Generator, motion: Motion
    ) -> tuple[Image, Image]:
        """Projected light off the skin, and the skin's albedo, each (height, width, 3)."""
        light, grid = self._light, pixel_grid(self.rig.camera)
        surface = visible_part(self.rig, surface)
        albedo = tones(surface)
        view = see(self.rig, surface, self.photometry, motion)
        jitter = np.zeros(grid.shape)
        if self.photometry.phase_noise_px:
            jitter = rng.normal(0, self.photometry.phase_noise_px, grid.shape)
        position = np.stack([light.column_index(view.u + jitter), light.row_index(view.v)])
        slopes = [np.gradient(position, axis=2), np.gradient(position, axis=1)]
        if motion:
            # What is odd in time cancels over the exposure, so that one more moment will do.
            later = see(self.rig, surface, self.photometry, motion, 0.5)
            moved = [light.column_index(later.u + jitter), light.row_index(later.v)]
            slopes.append(2 * (np.stack(moved) - position))
        points = _lattice(self.photometry.samples)
        total = np.zeros((*grid.shape, 4), np.float32)
        for point in points:
            column, row = position
            for weight, slope in zip(point, slopes, strict=False):
                column = cv2.scaleAdd(slope[0], weight, column)
                row = cv2.scaleAdd(slope[1], weight, row)
            light.add_image(total, column, row)
        tone = albedo[view.tone]
        factor = tone * view.diffuse[..., None].astype(np.float32)
        if view.specular.any():
            factor += view.specular[..., None].astype(np.float32)
        lit = light.scaled(total, len(points)) * factor

        sweep = image_sweep(self.rig, surface, motion)
        for pixels in broken_pixels(self.rig, surface, view, sweep):
            rays = grid.rays_within(pixels, points[:, 0], points[:, 1]).reshape(-1, 3)
            moments = np.tile(points[:, 2], len(pixels))
            fine = look(self.rig, surface, rays, self.photometry, motion, moments)
            fine.u += np.repeat(jitter.ravel()[pixels], len(points))
            skin = albedo[fine.tone]
            glow = light.at(fine.u, fine.v)
            glow *= skin * fine.diffuse[:, None] + fine.specular[:, None]
            at = np.divmod(pixels, grid.shape[1])
            lit[at] = glow.reshape(len(pixels), -1, 3).mean(axis=1)
            tone[at] = skin.reshape(len(pixels), -1, 3).mean(axis=1)
        return lit, tone


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


def _lattice(count: int) -> NDArray[np.float64]:
    """Points (column, row, time) from -1/2 to 1/2, symmetric about 0, shape (count, 3)."""
    odd = 2 * np.arange(count) + 1
    return (np.outer(odd, _LATTICE) % (2 * count)) / (2 * count) - 0.5
