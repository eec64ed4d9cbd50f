"""Photographs of a surface in the projector's light, by physics alone."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import erf

from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation.paint import sampled
from ftp_dent_ros.simulation.sensor import Image, Photometry, reach_of, read_out, speckle
from ftp_dent_ros.simulation.surface import Surface, paint_on, sun_on
from ftp_dent_ros.simulation.view import (
    CameraMotion,
    View,
    albedo_table,
    broken_pixels,
    look,
    pixel_grid,
    see,
    sight,
    visible_part,
)

# Samples a projector pixel along u. OpenCV 4 rounds positions to 1/32 of a sample.
_FINE = 4
_FULL = 60000.0


class Light:
    """Light that leaves the projector towards each point of its image.

    Parameters
    ----------
    projected : ndarray, shape (height, width, 3), uint8
        The projected image, RGB.
    photometry : Photometry

    Notes
    -----
    A pixel is a square of even light; the lens blurs it with a Gaussian; around the frame there
    is no light, not even the projector's black. The field is sampled `_FINE` times a pixel
    along u, where fringes vary, and once along v; in between it is linear.
    """

    unit = np.float32(1 / _FULL)

    def __init__(self, projected: NDArray[np.uint8], photometry: Photometry) -> None:
        level = (np.arange(256) / 255) ** photometry.projector_gamma
        level = photometry.projector_black + (1 - photometry.projector_black) * level
        light: Image = (_FULL * level).astype(np.float32)[projected]
        self._border = math.ceil(4 * photometry.defocus_px) + 2
        border = ((self._border, self._border), (self._border, self._border), (0, 0))
        light = np.repeat(np.pad(light, border), _FINE, axis=1)
        # Linear interpolation blurs too, by a variance of a sixth of a sample.
        blur = max((_FINE * photometry.defocus_px) ** 2 - 1 / 6, 0)
        along_u = _pixel_kernel(math.sqrt(blur))
        along_v = _pixel_kernel(photometry.defocus_px)
        light = cv2.sepFilter2D(light, -1, along_u, along_v, borderType=cv2.BORDER_REPLICATE)
        # Four channels of 16 bits are what cv2.remap is quickest with.
        self._field = np.zeros((*light.shape[:2], 4), np.uint16)
        self._field[..., :3] = np.rint(light)

    def index(self, u: NDArray, v: NDArray) -> Image:
        """Index (column, row) into the field of projector pixels of one shape, shape (2, ...)."""
        first = _FINE * (self._border + 0.5) - 0.5
        return np.array([_FINE * u + first, v + self._border], np.float32)

    def at(self, u: NDArray, v: NDArray) -> Image:
        """Light, 0 to 1, at a list of projector pixels of shape (n,), shape (3, n)."""
        return self.sample(*self.index(u, v))[:, :3].T * self.unit

    def sample(self, column: NDArray, row: NDArray) -> Image:
        """Light at indices of one shape, in units of `unit`, shape (..., 4)."""
        return sampled(self._field, column, row)


def _pixel_kernel(sigma: float) -> Image:
    """Gaussian blur integrated over each sample's width: weights of the samples around one."""
    if sigma == 0:
        return np.ones(1, np.float32)
    reach = math.ceil(4 * sigma)
    edges = np.arange(-reach, reach + 2) - 0.5
    weights = np.diff(erf(edges / (math.sqrt(2) * sigma)))
    return (weights / weights.sum()).astype(np.float32)


def moved(fields: Image, slopes: list[Image], point: NDArray) -> Image:
    """Fields of shape (..., h, w), float32, at a point of the pixels and the exposure."""
    rows = fields.reshape(-1, fields.shape[-1])
    for axis in np.flatnonzero(point):
        rows = cv2.scaleAdd(slopes[axis].reshape(rows.shape), point[axis], rows)
    return rows.reshape(fields.shape)


def colours(light: Image, scale: float) -> Image:
    """Light of shape (h, w, 4) times a factor, shape (3, h, w)."""
    return np.multiply(np.moveaxis(light, -1, 0)[:3], np.float32(scale), order='C')


def cubature(dimensions: int, intervals: int) -> NDArray[np.float64]:
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


def lattice(count: int) -> NDArray[np.float64]:
    """Points (column, row, time) from -1/2 to 1/2, symmetric about 0, shape (count, 3)."""
    odd = 2 * np.arange(count) + 1
    # Generators of a rank-1 lattice over (column, row, time): evenly spread in each of them alone
    # and in the sums of them along which moving fringes run.
    return (np.outer(odd, (1, 19, 53)) % (2 * count)) / (2 * count) - 0.5


def image_sweep(rig: Rig, surface: Surface, motion: CameraMotion) -> float:
    """How far the image moves during the exposure, at most, pixels."""
    rays = pixel_grid(rig.camera).node_rays[::4, ::4].reshape(-1, 3)
    depth = surface.intersect(rays)
    seen = np.isfinite(depth)
    points = depth[seen, None] * rays[seen]
    moved = Rotation.from_rotvec(motion.rotation).apply(points) + motion.translation
    shift = rig.camera.project(moved) - rig.camera.project(points)
    return float(np.hypot(*shift.T).max(initial=0.0))


def drift_of(
    rig: Rig, surface: Surface, view: View, motion: CameraMotion, photometry: Photometry
) -> NDArray[np.float32]:
    """How far what a pixel sees moves during the exposure.

    That of the bare skin: it only sets how far the blur reaches. Where skin slides past by a
    tenth of a small dent's width, that is right to one or two grey levels.

    Returns
    -------
    ndarray, shape (4, height, width)
        Of the index into the light (column, row); of x and y on the panel, metres.
    """
    grid = pixel_grid(rig.camera)
    nodes = grid.node_rays.reshape(-1, 1, 3)
    drift = np.zeros((4, *view.tone.shape), np.float32)
    for index, panel in enumerate(surface.panels):
        begin, end = (
            np.stack(sight(rig, panel.bare, motion.rays(nodes, [moment]), photometry)[1:5])
            for moment in (-0.5, 0.5)
        )
        change = np.nan_to_num(end - begin)[[2, 3, 0, 1]].reshape(4, *grid.node_rays.shape[:2])
        for target, values in zip(drift, change.astype(np.float32), strict=True):
            np.copyto(target, grid.interpolated(values), where=view.tone // 2 == index)
    drift[0] *= _FINE
    return drift


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
        motion: CameraMotion | None = None,
    ) -> Photograph:
        """Photograph a surface, in the encoding of the photometry.

        Parameters
        ----------
        surface : Surface
            In the camera's optical frame, in mid-exposure.
        rng : numpy.random.Generator, optional
            Of the noise; seeded with 0 if left out.
        motion : CameraMotion, optional
            Of the surface during the exposure.
        """
        rng = rng or np.random.default_rng(0)
        # The lens brings in light from beyond the image.
        beyond = reach_of(self.photometry.psf_px)
        wider = copy.copy(self)
        wider.rig = replace(self.rig, camera=self.rig.camera.padded(beyond))
        return read_out(wider.signal(surface, rng, motion), self.photometry, rng, beyond)

    def render(
        self,
        surface: Surface,
        rng: np.random.Generator | None = None,
        motion: CameraMotion | None = None,
    ) -> NDArray[np.uint8]:
        """RGB of 8 bits, shape (camera height, camera width, 3), of such a photograph."""
        return self.photograph(surface, rng, motion).shown()

    def signal(
        self,
        surface: Surface,
        rng: np.random.Generator | None = None,
        motion: CameraMotion | None = None,
    ) -> Image:
        """Light on the sensor, before the lens's blur, noise and saturation.

        Parameters are those of `photograph`.

        Returns
        -------
        ndarray, shape (3, camera height, camera width), float32
            1 saturates.
        """
        rng = rng or np.random.default_rng(0)
        motion = motion or CameraMotion()
        surface = visible_part(self.rig, surface)
        view = see(self.rig, surface, self.photometry)
        if self.photometry.phase_noise_px:
            view.u[...] += rng.normal(0, self.photometry.phase_noise_px, view.u.shape)
        sweep = image_sweep(self.rig, surface, motion)
        # On the panel in float32: to a thousandth of a pixel.
        skin = np.stack([view.x, view.y]).astype(np.float32)
        place = np.concatenate([self._light.index(view.u, view.v), skin])
        slopes = [np.gradient(place, axis=axis) for axis in (2, 1)]
        if sweep:
            slopes.append(drift_of(self.rig, surface, view, motion, self.photometry))
        if any(panel.paint.marks or panel.sunlight for panel in surface.panels):
            lit, ambient = self._marked_skin(surface, view, place, slopes)
        else:
            lit, ambient = self._even_skin(surface, view, place, slopes, sweep)
        for pixels in broken_pixels(self.rig, surface, view, sweep):
            at = (slice(None), *np.divmod(pixels, view.u.shape[1]))
            lit[at], ambient[at] = self._broken_skin(surface, motion, pixels, rng)
        if self.photometry.speckle_contrast:
            lit *= speckle(lit.shape, self.photometry, rng)
        lit += ambient
        gain = np.float32(self.photometry.exposure)
        lit *= gain * pixel_grid(self.rig.camera).vignette if self.photometry.shading else gain
        return lit

    def _even_skin(
        self, surface: Surface, view: View, place: Image, slopes: list[Image], sweep: float
    ) -> tuple[Image, Image]:
        """Light off a skin without marks, which changes evenly over a pixel and the exposure."""
        # One set of points integrates a fringe that moves over two pixels.
        points = cubature(len(slopes), math.ceil(sweep / 2.0))
        slopes = [slope[:2] for slope in slopes]
        total = np.zeros((*view.u.shape, 4), np.float32)
        for point in points:
            cv2.accumulate(self._light.sample(*moved(place[:2], slopes, point)), total)
        lit = colours(total, self._light.unit / np.float32(len(points)))
        ambient: Image = np.stack([cv2.LUT(view.tone, tone) for tone in albedo_table(surface)])
        ambient *= view.clean
        for channel, albedo in zip(lit, ambient, strict=True):
            channel *= albedo * view.diffuse + view.specular
        ambient *= np.float32(self.photometry.ambient)
        return lit, ambient

    def _marked_skin(
        self, surface: Surface, view: View, place: Image, slopes: list[Image]
    ) -> tuple[Image, Image]:
        """Light off a skin whose marks may end anywhere within a pixel."""

        def smooth_at(at: Image) -> Image:
            # Dirt is grey.
            return paint_on(surface, view.tone, at[2], at[3], (True,))[0]

        smooth = smooth_at(place)
        smooth_slopes = [np.gradient(smooth, axis=1), np.gradient(smooth, axis=0)]
        smooth_slopes += [smooth_at(place + d / 2) - smooth_at(place - d / 2) for d in slopes[2:]]
        plain = np.zeros((*view.u.shape, 4), np.float32)
        diffuse = np.zeros((3, *view.u.shape), np.float32)
        ambient = np.zeros_like(diffuse)
        level = np.float32(self.photometry.ambient)
        for point in self._points[:, : len(slopes)]:
            column, row, x, y = moved(place, slopes, point)
            sample = self._light.sample(column, row)
            paint = paint_on(surface, view.tone, x, y, (False,))
            paint *= moved(smooth, smooth_slopes, point)
            cv2.accumulate(sample, plain)
            diffuse += np.moveaxis(sample, -1, 0)[:3] * paint
            ambient += (sun_on(surface, view.tone, x, y) + level) * paint
        diffuse *= self._light.unit / np.float32(len(self._points))
        ambient /= len(self._points)
        lit = colours(plain, self._light.unit / np.float32(len(self._points)))
        lit *= view.specular
        for channel, tone in enumerate(albedo_table(surface)):
            albedo = cv2.LUT(view.tone, tone) * view.clean
            lit[channel] += diffuse[channel] * albedo * view.diffuse
            ambient[channel] *= albedo
        return lit, ambient

    def _broken_skin(
        self,
        surface: Surface,
        motion: CameraMotion,
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
            fine.u[...] += np.broadcast_to(noise[:, None], shape).ravel()
        on_skin = surface, fine.tone, fine.x, fine.y
        albedo = albedo_table(surface)[:, fine.tone] * paint_on(*on_skin) * fine.clean
        light = self._light.at(fine.u, fine.v) * (albedo * fine.diffuse + fine.specular)
        ambient = albedo * (self.photometry.ambient + sun_on(*on_skin))
        return light.reshape(3, *shape).mean(axis=2), ambient.reshape(3, *shape).mean(axis=2)


def render(
    rig: Rig,
    projected: NDArray[np.uint8],
    surface: Surface,
    photometry: Photometry | None = None,
    rng: np.random.Generator | None = None,
    motion: CameraMotion | None = None,
) -> NDArray[np.uint8]:
    """Photograph a surface once: see `Renderer`, which is quicker for more of them."""
    return Renderer(rig, projected, photometry).render(surface, rng, motion)
