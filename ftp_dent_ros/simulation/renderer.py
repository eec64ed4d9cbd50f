"""Photographs of a surface in the projector's light, by physics alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import erf

from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation.sensor import Photometry, read_out, speckle
from ftp_dent_ros.simulation.surface import Panel, Surface, is_even, paint_and_sun, smooth_paint
from ftp_dent_ros.simulation.view import (
    CameraMotion,
    Rays,
    View,
    albedo_table,
    broken_pixels,
    look,
    pixel_grid,
    projector_pixel,
    see,
    visible_part,
)

# Samples a projector pixel along u. OpenCV 4 rounds positions to 1/32 of a sample.
_FINE = 4
_FULL = 60000.0
# Image rows that `at` makes of a list of positions: OpenCV limits a side to 32767.
_COLUMNS = 4096

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]


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
        column = np.multiply(u, _FINE, dtype=float)
        column += _FINE * (self._border + 0.5) - 0.5
        return np.array([column, v + self._border], np.float32)

    def index_change(self, drift: NDArray) -> Image:
        """Change of an index with a change of projector pixels, both of shape (2, ...)."""
        scale = np.array([_FINE, 1], np.float32)
        return drift * scale.reshape(2, *(1,) * (drift.ndim - 1))

    def add(self, total: Image, column: Image, row: Image) -> None:
        """Add the light at indices of shape (h, w) to a sum of shape (h, w, 4)."""
        cv2.accumulate(self.sample(column, row), total)

    def mean(self, total: Image, count: int) -> Image:
        """Mean of the `count` images of light, 0 to 1, that were added, shape (3, h, w)."""
        scale = self.unit / np.float32(count)
        return np.stack([total[..., channel] * scale for channel in range(3)])

    def at(self, u: NDArray, v: NDArray) -> Image:
        """Light, 0 to 1, at a list of projector pixels of shape (n,), shape (3, n)."""
        rows = -(-len(u) // _COLUMNS)
        index = np.full((2, rows * _COLUMNS), -1.0, np.float32)
        index[:, : len(u)] = self.index(u, v)
        column, row = index.reshape(2, rows, _COLUMNS)
        light = self.sample(column, row).reshape(-1, 4)[: len(u), :3]
        return light.T * self.unit

    def sample(self, column: NDArray, row: NDArray) -> Image:
        """Light at indices of shape (h, w), in units of `unit`, shape (h, w, 4)."""
        return cv2.remap(self._field, column, row, cv2.INTER_LINEAR, borderValue=0)


def _pixel_kernel(sigma: float) -> Image:
    """Gaussian blur integrated over each sample's width: weights of the samples around one."""
    if sigma == 0:
        return np.ones(1, np.float32)
    reach = math.ceil(4 * sigma)
    edges = np.arange(-reach, reach + 2) - 0.5
    weights = np.diff(erf(edges / (math.sqrt(2) * sigma)))
    return (weights / weights.sum()).astype(np.float32)


def moved(place: Image, slopes: list[Image], point: NDArray) -> tuple[Image, Image]:
    """Two fields, shape (2, h, w), float32, at a point of the pixels and the exposure."""
    first, second = (
        shifted(field, [slope[index] for slope in slopes], point)
        for index, field in enumerate(place)
    )
    return first, second


def shifted(field: Image, slopes: list[Image], point: NDArray) -> Image:
    """A field of shape (h, w), float32, at a point of the pixels and the exposure."""
    for axis in np.flatnonzero(point):
        field = cv2.scaleAdd(slopes[axis], point[axis], field)
    return field


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
    if not motion:
        return 0.0
    rays = pixel_grid(rig.camera).node_rays[::4, ::4].reshape(-1, 3)
    depth = surface.intersect(rays)
    seen = np.isfinite(depth)
    points = depth[seen, None] * rays[seen]
    moved = Rotation.from_rotvec(motion.rotation).apply(points) + motion.translation
    shift = rig.camera.project(moved) - rig.camera.project(points)
    return float(np.hypot(*shift.T).max(initial=0.0))


def light_drift(
    rig: Rig, surface: Surface, view: View, motion: CameraMotion
) -> NDArray[np.float32]:
    """How far the projector pixel (u, v) that a pixel sees moves during the exposure.

    That of the bare skin: it only sets how far the blur reaches. Where skin slides past by a
    tenth of a small dent's width, that is right to one or two grey levels.

    Returns
    -------
    ndarray, shape (2, height, width)
    """
    return _drift(
        rig,
        surface,
        view,
        motion,
        lambda _, rays, scale: projector_pixel(rig, scale[:, None] * rays.directions),
    )


def skin_drift(
    rig: Rig, surface: Surface, view: View, motion: CameraMotion
) -> NDArray[np.float32]:
    """How far the panel coordinates (x, y) that a pixel sees move during the exposure, metres.

    Those of the bare skin. Shape (2, height, width).
    """

    def place(panel: Panel, rays: Rays, _: NDArray) -> tuple[NDArray, NDArray]:
        return panel.hit_bare(rays.origin, rays.towards)[1:]

    return _drift(rig, surface, view, motion, place)


def _drift(
    rig: Rig,
    surface: Surface,
    view: View,
    motion: CameraMotion,
    place: Callable[[Panel, Rays, NDArray], tuple[NDArray, NDArray]],
) -> NDArray[np.float32]:
    """How far what is seen moves during the exposure, shape (2, height, width)."""
    grid = pixel_grid(rig.camera)
    nodes = grid.node_rays.reshape(-1, 1, 3)
    drift = np.zeros((2, *grid.shape), np.float32)
    for index, panel in enumerate(surface.panels):
        ends = []
        for moment in (-0.5, 0.5):
            rays = motion.rays(nodes, [moment])
            scale, _, _ = panel.hit_bare(rays.origin, rays.towards)
            ends.append(np.stack(place(panel, rays, scale)))
        change = np.nan_to_num(ends[1] - ends[0]).reshape(2, *grid.node_rays.shape[:2])
        for target, values in zip(drift, change.astype(np.float32), strict=True):
            np.copyto(target, grid.interpolated(values), where=view.tone // 2 == index)
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
        return read_out(self.signal(surface, rng, motion), self.photometry, rng)

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
        lit, ambient = self._gather(surface, rng, motion or CameraMotion())
        if self.photometry.speckle_contrast:
            lit *= speckle(lit.shape, self.photometry, rng)
        lit += ambient
        gain = np.float32(self.photometry.exposure)
        lit *= gain * pixel_grid(self.rig.camera).vignette if self.photometry.shading else gain
        return lit

    def _gather(
        self, surface: Surface, rng: np.random.Generator, motion: CameraMotion
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
        self, surface: Surface, view: View, motion: CameraMotion, sweep: float
    ) -> tuple[Image, Image]:
        """Light off a skin without marks, which changes evenly over a pixel and the exposure.

        The image moves by `sweep` pixels during the exposure.
        """
        light = self._light
        place, slopes = self._positions(surface, view, motion)
        # Longest way of the image, pixels, over which one set of points integrates a moving
        # fringe.
        points = cubature(len(slopes), math.ceil(sweep / 2.0))
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

    def _marked_skin(
        self, surface: Surface, view: View, motion: CameraMotion
    ) -> tuple[Image, Image]:
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
        self, surface: Surface, view: View, motion: CameraMotion
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
    motion: CameraMotion | None = None,
) -> NDArray[np.uint8]:
    """Photograph a surface once: see `Renderer`, which is quicker for more of them."""
    return Renderer(rig, projected, photometry).render(surface, rng, motion)
