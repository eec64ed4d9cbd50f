"""What a demonstration leaves: pictures, clouds, the summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ftp_dent_ros.cloud.ply import write_ply
from ftp_dent_ros.coding.images import image_from_message
from ftp_dent_ros.demonstration.appraisal import (
    Figures,
    camera_error,
    clouds_of,
    image_at,
    mean_absolute,
)
from ftp_dent_ros.files import write_atomically
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.clouds import rig_id_of
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.simulation.surface import Surface
from ftp_dent_ros.simulation.world import World

_MM = 1000.0

# First, middle and last are enough to look at; the bag has them all.
_KEPT = 3

# What the payload promises in this simulation: how many, and millimetres. A busy machine may leave
# photographs out, which is shown.
BOUNDS = {
    'images_lost': 0,
    'tagged_clouds_lost': 0,
    'poses_lost': 0,
    'camera_mae_mm': 0.1,
    # By the autopilot's poses, which err as a real one's: 7 cm and 1.1 degrees at most.
    'map_mae_mm': 100.0,
    'skin_mae_mm': 0.1,
    'clouds_not_inspected': 0,
    'dents_missed': 0,
    'sightings_missed': 0,
    'dents_false': 0,
    'dents_false_in_list': 0,
}


def error_map(path: Path, error: NDArray[np.float64], title: str) -> None:
    """Draw signed distances to the true surface, shape (rows, columns), metres."""
    figure = Figure(figsize=(9, 5), layout='constrained')
    axes = figure.add_subplot()
    axes.set(title=title, xlabel='column of the cloud', ylabel='row of the cloud')
    limit = float(np.nanpercentile(np.abs(error), 99)) * _MM
    colours = matplotlib.colormaps['RdBu_r'].copy()
    colours.set_bad('0.85')
    image = axes.imshow(error * _MM, colours, vmin=-limit, vmax=limit, interpolation='nearest')
    figure.colorbar(image, ax=axes, label='behind (+) or before (-) the true skin, mm')
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


def _save(figure: Figure, path: Path) -> None:
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=110)


def write_results(
    bag: Bag,
    world: World,
    poses: Mapping[int, Pose],
    folder: Path,
    progress: Callable[[], Any],
) -> None:
    """Write clouds and pictures of a recorded flight into `folder`.

    `poses` are the cameras' by the skin, put onto the true one, by the clouds' stamps.

    ``clouds/`` takes the first, the middle and the last cloud in the camera's frame and in
    ``map``; the pictures of a single photograph are those of the one in the middle.
    """
    stamps = [stamp for stamp, _ in clouds_of(bag, '/tagged/points')]
    if not stamps:
        return
    kept = {stamps[round(i * (len(stamps) - 1) / (_KEPT - 1))] for i in range(_KEPT)}
    middle = stamps[len(stamps) // 2]
    rig_id = rig_id_of(bag)
    for topic, frame in (('/points', 'camera'), ('/tagged/points', 'map')):
        frame_id = 'camera_optical_frame' if frame == 'camera' else 'map'
        for stamp, cloud in clouds_of(bag, topic):
            if stamp in kept:
                number = stamps.index(stamp)
                path = folder / 'clouds' / f'cloud_{number:03}_{frame}.ply'
                write_ply(path, cloud, frame_id, rig_id)
                progress()
    _pictures_of_one(bag, world, middle, folder, progress)
    _picture_of_all(bag, world, poses, folder)
    progress()


def _pictures_of_one(
    bag: Bag, world: World, stamp_ns: int, folder: Path, progress: Callable[[], Any]
) -> None:
    message = image_at(bag, stamp_ns)
    if message is not None:
        image = cv2.cvtColor(image_from_message(message), cv2.COLOR_RGB2BGR)
        with write_atomically(folder / 'camera.png') as temporary:
            cv2.imwrite(str(temporary), image)
        progress()
    cloud = next(cloud for stamp, cloud in clouds_of(bag, '/points') if stamp == stamp_ns)
    error = camera_error(world, cloud, stamp_ns)
    title = f'Error in the camera frame, MAE {mean_absolute(error):.4f} mm'
    error_map(folder / 'error_camera.png', error, title)
    progress()


def _picture_of_all(bag: Bag, world: World, poses: Mapping[int, Pose], folder: Path) -> None:
    """The measured skin along the flight, coloured by how deep it lies behind the undented one."""
    every = []
    for stamp, cloud in clouds_of(bag, '/points'):
        if stamp in poses:
            points = cloud.points[cloud.valid].astype(np.float64)
            # As many points as a 3-D picture of this size can show.
            step = max(1, len(points) * len(poses) // 120_000)
            every.append(poses[stamp].apply(points[::step]))
    skin = np.concatenate(every)
    undented = Surface(tuple(replace(panel, dents=()) for panel in world.surface.panels))
    flight = [world.base_pose(stamp) for stamp in poses]
    view_3d(folder / 'view_3d.png', skin, undented.distance(skin), flight)


_SUMMARY = """\
exposure to tagged cloud  {latency_median_ms:.0f} ms median, {latency_maximum_ms:.0f} ms at most
dents in view             {dents}, missed {dents_missed}, false {dents_false}
largest error of a dent   depth {depth_error_mm:.3f} mm, length {length_error_mm:.2f} mm, \
width {width_error_mm:.2f} mm
error of the clouds       {camera_mae_mm:.4f} mm mean, worst cloud {camera_mae_worst_mm:.4f} mm
error of the joined skin  {skin_mae_mm:.4f} mm mean, worst cloud {skin_mae_worst_mm:.4f} mm
by the autopilot's poses  {map_mae_mm:.1f} mm mean, worst cloud {map_mae_worst_mm:.1f} mm
images                    {images}, lost {images_lost}
clouds                    {clouds}, not inspected {clouds_not_inspected}; left out because this \
machine was busy {clouds_lost}
tagged clouds             {tagged_clouds}, lost {tagged_clouds_lost}
autopilot poses           {poses}, lost {poses_lost}
sightings of dents        {sightings}, missed {sightings_missed}
listed as others          {others}
dents in the node's list  {dents_in_list}, false {dents_false_in_list}
parts of the skin         {skin_parts}; points {skin_place_mm:.3f} mm from their places on it, \
the whole {skin_off_mm:.0f} mm off in the map"""


def summary_of(figures: Figures) -> str:
    """The figures as people read them, a line each: those that matter most first."""
    return _SUMMARY.format(**figures)
