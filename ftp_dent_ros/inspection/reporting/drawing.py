"""The pictures of the page, as data that stands in it."""

from __future__ import annotations

import base64

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ftp_dent_ros.inspection.reporting.content import View
from ftp_dent_ros.rig.rig import Lens

COLOURS = 'RdBu_r'
_NOTHING = (225, 227, 230)
# Metres around what is looked for on a grid: outlines lie on the measured skin.
_BESIDE = 0.02
# Metres; what is finite is nearer.
_FARTHEST = float(np.finfo(np.float32).max)


def colour_table() -> NDArray[np.uint8]:
    """RGB of 256 steps from the most outward to the most inward, shape (256, 3)."""
    table = matplotlib.colormaps[COLOURS](np.linspace(0, 1, 256))[:, :3]
    return np.round(255 * table).astype(np.uint8)


def heat_map(deviation: NDArray[np.float32], limit: float) -> str:
    """Deviation as a PNG's data URI, a pixel a point; from -limit to limit, metres."""
    index = np.clip(np.nan_to_num(deviation / limit) * 127.5 + 127.5, 0, 255)
    pixels = colour_table()[index.astype(np.uint8)]
    pixels[~np.isfinite(deviation)] = _NOTHING
    return png(pixels)


def png(pixels: NDArray[np.uint8]) -> str:
    """RGB pixels as a data URI."""
    _, data = cv2.imencode('.png', np.ascontiguousarray(pixels[..., ::-1]))
    return data_uri(data.tobytes(), 'image/png')


def jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """RGB pixels as a JPEG file."""
    _, data = cv2.imencode(
        '.jpg', np.ascontiguousarray(pixels[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 88]
    )
    return data.tobytes()


def data_uri(data: bytes, kind: str) -> str:
    """Data as they stand in a page that needs no other file."""
    return f'data:{kind};base64,{base64.b64encode(data).decode("ascii")}'


def on_grid(points: NDArray[np.float64], view: View) -> NDArray[np.float64]:
    """Column and row of points of the report's frame on a cloud's grid, shape (n, 2)."""
    points = view.pose.inverse().apply(np.asarray(points, float))
    grid = view.points
    if not len(points) or not np.isfinite(grid[..., 2]).any():
        return np.full((len(points), 2), np.nan)
    row, column = _nearest(points, grid)
    # From the nearest point on, along the grid's own directions.
    steps = []
    for axis in (1, 0):
        low, high = (
            np.clip(np.stack([row, column], -1) + sign * np.array([axis == 0, axis == 1]), 0, None)
            for sign in (-1, 1)
        )
        high = np.minimum(high, np.array(grid.shape[:2]) - 1)
        change = _at(grid, high[:, 0], high[:, 1]) - _at(grid, low[:, 0], low[:, 1])
        steps.append(change / np.maximum((high - low).sum(axis=1), 1)[:, None])
    beyond = points - _at(grid, row, column)
    basis = np.stack(steps, axis=-1)
    gram = basis.transpose(0, 2, 1) @ basis
    right = (basis.transpose(0, 2, 1) @ beyond[..., None])[..., 0]
    found = np.stack([column, row], axis=-1).astype(float)
    finite = np.isfinite(gram).all(axis=(1, 2))
    usable = finite & (np.abs(np.linalg.det(np.where(finite[:, None, None], gram, 0))) > 0)
    shift = np.zeros_like(found)
    shift[usable] = np.linalg.solve(gram[usable], right[usable][..., None])[..., 0]
    return found + np.clip(shift, -2, 2)


def _nearest(
    points: NDArray[np.float64], grid: NDArray[np.float32]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the measured points that are nearest to some points, each shape (n,)."""
    low, high = points.min(axis=0) - _BESIDE, points.max(axis=0) + _BESIDE
    for bounds in ((low, high), (np.full(3, -_FARTHEST), np.full(3, _FARTHEST))):
        # Much faster than comparisons of a coordinate each; what is not a number lies nowhere.
        rows, columns = np.nonzero(cv2.inRange(grid, *bounds))
        if len(rows):
            # Made in a third of the time of a balanced one, for a few questions.
            tree = cKDTree(_at(grid, rows, columns), balanced_tree=False, compact_nodes=False)
            distance, nearest = tree.query(points)
            if distance.max() <= _BESIDE:
                break
    return rows[nearest], columns[nearest]


def _at(grid: NDArray, rows: NDArray, columns: NDArray) -> NDArray[np.float64]:
    return np.asarray(grid[rows, columns], float)


def on_photograph(
    points: NDArray[np.float64], place: NDArray[np.float64], view: View, camera: Lens | None
) -> NDArray[np.float64]:
    """Pixels of points of the report's frame in a cloud's photograph, shape (n, 2).

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    place : ndarray, shape (n, 2)
        Theirs `on_grid`.
    view : View
    camera : Lens or None
        If the cloud is in its frame; else the cloud's own grid says where a point is.
    """
    if camera is not None:
        return camera.project(view.pose.inverse().apply(np.asarray(points, float)))
    rows, columns = view.deviation.shape
    width, height = view.size
    # Every n-th pixel from the first has a point.
    stride = max(round(width / columns), round(height / rows), 1)
    return place * stride
