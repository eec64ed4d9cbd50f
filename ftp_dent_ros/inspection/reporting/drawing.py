"""The pictures of the page, as data that stands in it."""

from __future__ import annotations

import base64
import io
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.reporting.content import View
from ftp_dent_ros.rig import Lens

COLOURS = 'RdBu_r'
_MM = 1000.0
_INK, _FAINT, _ACCENT = '#1b1f24', '#8a929b', '#b2182b'
_NOTHING = (225, 227, 230)


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
    grid = view.points.astype(float)
    rows, columns = np.nonzero(np.isfinite(grid).all(axis=-1))
    if not len(rows) or not len(points):
        return np.full((len(points), 2), np.nan)
    _, nearest = cKDTree(grid[rows, columns]).query(points)
    row, column = rows[nearest], columns[nearest]
    # From the nearest point on, along the grid's own directions.
    steps = []
    for axis in (1, 0):
        low, high = (
            np.clip(np.stack([row, column], -1) + sign * np.array([axis == 0, axis == 1]), 0, None)
            for sign in (-1, 1)
        )
        high = np.minimum(high, np.array(grid.shape[:2]) - 1)
        change = grid[high[:, 0], high[:, 1]] - grid[low[:, 0], low[:, 1]]
        steps.append(change / np.maximum((high - low).sum(axis=1), 1)[:, None])
    beyond = points - grid[row, column]
    basis = np.stack(steps, axis=-1)
    gram = basis.transpose(0, 2, 1) @ basis
    right = (basis.transpose(0, 2, 1) @ beyond[..., None])[..., 0]
    found = np.stack([column, row], axis=-1).astype(float)
    finite = np.isfinite(gram).all(axis=(1, 2))
    usable = finite & (np.abs(np.linalg.det(np.where(finite[:, None, None], gram, 0))) > 0)
    shift = np.zeros_like(found)
    shift[usable] = np.linalg.solve(gram[usable], right[usable][..., None])[..., 0]
    return found + np.clip(shift, -2, 2)


def on_photograph(
    points: NDArray[np.float64], view: View, camera: Lens | None
) -> NDArray[np.float64]:
    """Pixels of points of the report's frame in a cloud's photograph, shape (n, 2).

    Parameters
    ----------
    points : ndarray, shape (n, 3)
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
    return on_grid(points, view) * stride


def profiles(dent: MeasuredDent, limit: float) -> str:
    """Sections along length and width as an SVG's data URI; `limit` is the scale's end, mm."""
    style: dict[Any, Any] = {
        'font.size': 8,
        'axes.edgecolor': _FAINT,
        'svg.hashsalt': 'ftp_dent_ros',
    }
    style |= {'text.color': _INK, 'axes.labelcolor': _INK, 'xtick.color': _INK}
    style |= {'ytick.color': _INK, 'font.family': 'sans-serif'}
    with matplotlib.rc_context(style):
        figure = Figure(figsize=(7.0, 1.9), layout='constrained')
        left, right = figure.subplots(1, 2, sharey=True)
        for axes, name, profile, size in (
            (left, 'length', dent.length_profile, dent.length.value),
            (right, 'width', dent.width_profile, dent.width.value),
        ):
            _section(axes, profile, size, dent.depth.value)
            axes.set_xlabel(f'along the {name}, mm')
        low = min(-0.15 * limit, _lowest(dent) * _MM)
        left.set_ylim(limit, low)
        left.set_ylabel('depth, mm')
        text = io.BytesIO()
        figure.savefig(text, format='svg', metadata={'Date': None})
    return data_uri(text.getvalue(), 'image/svg+xml')


def _lowest(dent: MeasuredDent) -> float:
    both = np.concatenate([dent.length_profile, dent.width_profile])
    return float(np.nanmin(both[:, 1])) if len(both) and np.isfinite(both[:, 1]).any() else 0.0


def _section(axes, profile: NDArray[np.float64], size: float, depth: float) -> None:
    axes.spines[['top', 'right']].set_visible(False)
    axes.axhline(0, color=_FAINT, linewidth=0.8)
    if not len(profile):
        return
    at, below = profile.T * _MM
    axes.fill_between(at, 0, below, color=_ACCENT, alpha=0.12, linewidth=0)
    axes.plot(at, below, color=_ACCENT, linewidth=1.3)
    level = 0.1 * depth * _MM
    inside = at[np.isfinite(below) & (np.sign(depth) * below >= abs(level))]
    if len(inside) and np.isfinite(size):
        # Between the ends of the part that lies within the 10 % contour.
        axes.annotate(
            '',
            (inside.min(), level),
            (inside.max(), level),
            arrowprops={'arrowstyle': '<->', 'color': _INK, 'linewidth': 0.8, 'shrinkA': 0}
            | {'shrinkB': 0},
        )
        middle = (inside.min() + inside.max()) / 2
        axes.annotate(
            f'{size * _MM:.1f}',
            (middle, level),
            (0, 2),
            textcoords='offset points',
            ha='center',
            va='bottom',
        )
