"""What each pixel of a simulated photograph shows, and how far from an edge, exactly."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.simulation.renderer import Renderer
from ftp_dent_ros.simulation.surface import Surface, paint_on, sun_on
from ftp_dent_ros.simulation.view import NOTHING, CameraMotion, View, albedo_table, see

# A depth that changes by more than this from pixel to pixel, beyond what its slope there
# explains, is a step, metres: a fifth of the flattest lap that is asked about.
_STEP = 1e-4

EDGES = 'depth', 'shadow', 'albedo', 'clipping', 'rim'


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """The truth of a photograph, on every `stride`-th pixel: arrays of shape (rows, columns).

    Attributes
    ----------
    depth : ndarray, float64
        z of the surface in the camera's frame in mid-exposure, metres; NaN where there is none.
    along_ray : ndarray, float64
        Metres along a pixel's ray for one metre of z.
    lit : ndarray of bool
        The projector lights what is seen.
    lit_area : float
        Of the skin there, square metres.
    clipped : ndarray of bool
        A colour is saturated, noise and blur aside.
    u_p : ndarray, float64
        Projector column that lights it.
    period : ndarray, float64
        Camera pixels a fringe.
    edges : dict of ndarray, float64
        Distance to the nearest edge of each kind of `EDGES`, in fringes; infinite without one.
        ``depth`` are steps, ``shadow`` the sun's and the projector's shadows', ``albedo`` paint
        and marks, ``clipping`` where clipping begins, ``rim`` the lit area's own.
    """

    depth: NDArray[np.float64]
    along_ray: NDArray[np.float64]
    lit: NDArray[np.bool_]
    lit_area: float
    clipped: NDArray[np.bool_]
    u_p: NDArray[np.float64]
    period: NDArray[np.float64]
    edges: dict[str, NDArray[np.float64]]

    @property
    def nearest_edge(self) -> NDArray[np.float64]:
        """Distance to the nearest edge of any kind, fringes."""
        return np.min(list(self.edges.values()), axis=0)


def ground_truth(
    renderer: Renderer,
    surface: Surface,
    period_px: float,
    stride: int = 1,
    motion: CameraMotion | None = None,
) -> GroundTruth:
    """Truth of what a renderer's camera sees of a surface.

    Parameters
    ----------
    renderer : Renderer
    surface : Surface
        In the camera's optical frame, in mid-exposure.
    period_px : float
        Of the projected fringes, projector pixels.
    stride : int
        Of the grid.
    motion : CameraMotion, optional
        Of the surface during the exposure: it only decides what is clipped.
    """
    rig, photometry = renderer.rig, renderer.photometry
    view = see(rig, surface, photometry)
    rays = rig.camera.rays(rig.camera.pixel_grid())
    depth = surface.intersect(rays)
    on_skin = np.not_equal(view.tone, NOTHING)
    width, height = rig.projector.width, rig.projector.height
    lit = on_skin & (view.u > 0) & (view.u < width - 1) & (view.v > 0) & (view.v < height - 1)
    lit &= ~view.shadow
    clipped = np.greater(np.max(renderer.signal(surface, motion=motion), axis=0), 1)
    albedo, sun = _skin(surface, view)
    masks: dict[str, NDArray] = {
        'depth': _steps(depth, view.tone),
        'shadow': _changes(view.shadow) | _jumps(sun + photometry.ambient + 0.5),
        'albedo': _jumps(albedo) & ~_changes(on_skin),
        'clipping': _changes(clipped),
        'rim': _changes(lit),
    }
    masks['rim'][[0, -1]] = masks['rim'][:, [0, -1]] = True
    period = _period(view, period_px)
    grid = slice(None, None, stride), slice(None, None, stride)
    return GroundTruth(
        depth=depth[grid],
        along_ray=np.linalg.norm(rays, axis=-1)[grid],
        lit=lit[grid],
        lit_area=_area(rays * depth[..., None], lit),
        clipped=clipped[grid],
        u_p=np.where(lit, view.u, np.nan)[grid],
        period=period[grid],
        edges={name: (_distance(mask) / period)[grid] for name, mask in masks.items()},
    )


def _area(points: NDArray, lit: NDArray[np.bool_]) -> float:
    """Of the skin at lit pixels, square metres; pixels beside a step count as their neighbours."""
    patch = np.linalg.norm(
        np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0)), axis=-1
    )[lit]
    known = np.isfinite(patch)
    if not known.any():
        return 0.0
    return float(np.minimum(patch[known], 4 * np.median(patch[known])).mean() * lit.sum())


def _skin(surface: Surface, view: View) -> tuple[NDArray, NDArray]:
    """Albedo of green light, and the light of the sun, at each pixel's centre."""
    on_skin = surface, view.tone, view.x.astype(np.float32), view.y.astype(np.float32)
    green = albedo_table(surface)[1][view.tone]
    return green * paint_on(*on_skin)[1] * view.clean, sun_on(*on_skin)


def _steps(depth: NDArray, tone: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Pixels beside a step in the depth, or a panel's end."""
    mask = _changes(tone // 2)
    filled = np.nan_to_num(depth)
    for axis in (0, 1):
        # A second difference: what the slope before explains is no step.
        bend = np.abs(np.diff(filled, 2, axis=axis))
        middle = mask[1:-1] if axis == 0 else mask[:, 1:-1]
        middle |= bend > _STEP
    return mask


def _jumps(field: NDArray) -> NDArray[np.bool_]:
    """Pixels beside a relative change of a field that is positive."""
    level = np.log(np.maximum(field, 1e-3)).astype(np.float32)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    # A reflectance or light that changes by more than this part from pixel to pixel has an edge.
    return cv2.dilate(level, cross) - cv2.erode(level, cross) > 2 * 0.15


def _changes(label: NDArray) -> NDArray[np.bool_]:
    """Pixels whose neighbours along an axis have another label."""
    label = label.astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    return cv2.dilate(label, cross) != cv2.erode(label, cross)


def _distance(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Pixels to the nearest of a mask."""
    if not mask.any():
        return np.full(mask.shape, np.inf)
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5).astype(float)


def _period(view: View, period_px: float) -> NDArray[np.float64]:
    """Camera pixels a fringe, from the median change of the projector's column by columns."""
    slope = np.abs(np.gradient(view.u, axis=1))
    return np.clip(period_px / np.maximum(slope, 1e-6), 2, 200)
