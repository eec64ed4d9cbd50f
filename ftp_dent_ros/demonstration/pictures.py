"""The pictures of a demonstration: photograph, depth, error, and the skin in three dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.pose import Pose

_NOTHING = '0.85'
_MM = 1000.0


def depth_map(path: Path, cloud: Cloud) -> None:
    """Draw the depth of a cloud in the camera's frame."""
    figure, axes = _image_axes('Depth along the optical axis')
    depth = cloud.points[..., 2] * _MM
    low, high = (float(np.nanpercentile(depth, share)) for share in (0.5, 99.5))
    _draw(figure, axes, depth, low, high, 'viridis', 'depth, mm')
    _save(figure, path)


def error_map(path: Path, error: NDArray[np.float64], title: str) -> None:
    """Draw signed distances to the true surface, shape (rows, columns), metres."""
    figure, axes = _image_axes(title)
    limit = float(np.nanpercentile(np.abs(error), 99)) * _MM
    label = 'behind (+) or before (-) the true skin, mm'
    _draw(figure, axes, error * _MM, -limit, limit, 'RdBu_r', label)
    _save(figure, path)


def view_3d(
    path: Path,
    points: NDArray[np.float64],
    dent_depth: NDArray[np.float64],
    flight: Sequence[Pose],
) -> None:
    """Draw tagged points and the drone's path in the map.

    Parameters
    ----------
    path : Path
        Where the picture goes.
    points : ndarray, shape (n, 3)
        Points in ``map`` (ENU), metres.
    dent_depth : ndarray, shape (n,)
        How far each point lies behind the undented skin, metres: its colour.
    flight : sequence of Pose
        Poses of ``base_link`` in ``map``, in the order of time.
    """
    positions = np.array([pose.translation for pose in flight])
    forward = np.array([pose.rotation.apply((1, 0, 0)) for pose in flight])
    figure = Figure(figsize=(10, 4.8))
    # Matplotlib's annotations know of no third dimension.
    axes: Any = figure.add_axes((0.0, 0.0, 0.88, 0.95), projection='3d', computed_zorder=False)
    limit = float(np.percentile(dent_depth, 99.9)) * _MM
    colours = axes.scatter(
        *points.T, c=dent_depth * _MM, s=0.6, cmap='turbo', vmin=-0.1, vmax=limit, linewidths=0
    )
    axes.plot(*positions.T, color='black', linewidth=1.2, label="the drone's path and nose")
    axes.quiver(*positions.T, *(0.12 * forward).T, color='black', linewidth=0.6)
    every = np.concatenate([points, positions])
    axes.set_box_aspect(np.maximum(np.ptp(every, axis=0), 0.2), zoom=1.7)
    axes.set(xlabel='east, m', ylabel='north, m', zlabel='up, m')
    axes.locator_params(axis='z', nbins=3)
    figure.suptitle('The skin by its own poses, coloured by depth behind the undented one')
    # From behind the drone, a little to the side and above.
    behind = np.degrees(np.arctan2(*-forward.mean(axis=0)[[1, 0]]))
    axes.view_init(elev=18, azim=behind + 30)
    axes.legend(loc='upper left', bbox_to_anchor=(0.05, 0.95))
    scale = figure.add_axes((0.9, 0.2, 0.015, 0.6))
    figure.colorbar(colours, cax=scale, label='depth, mm')
    _save(figure, path)


def _image_axes(title: str):
    figure = Figure(figsize=(9, 5), layout='constrained')
    axes = figure.add_subplot()
    axes.set_title(title)
    axes.set(xlabel='column of the cloud', ylabel='row of the cloud')
    return figure, axes


def _draw(figure, axes, values, low: float, high: float, colours: str, label: str) -> None:
    colour_map = matplotlib.colormaps[colours].copy()
    colour_map.set_bad(_NOTHING)
    image = axes.imshow(values, cmap=colour_map, vmin=low, vmax=high, interpolation='nearest')
    figure.colorbar(image, ax=axes, label=label)


def _save(figure: Figure, path: Path) -> None:
    with written_aside(path) as aside:
        figure.savefig(aside, dpi=110)
