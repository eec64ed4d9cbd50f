"""What a demonstration leaves: pictures and the summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image

from ftp_dent_ros.coding.images import image_from_message
from ftp_dent_ros.demonstration.appraisal import Figures, clouds_of
from ftp_dent_ros.files import write_atomically, write_png
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.simulation.surface import Surface
from ftp_dent_ros.simulation.world import World

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
    limit = float(np.percentile(dent_depth, 99.9)) * 1e3
    colours = axes.scatter(
        *points.T, c=dent_depth * 1e3, s=0.6, cmap='turbo', vmin=-0.1, vmax=limit, linewidths=0
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
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=110)


def write_results(bag: Bag, world: World, poses: Mapping[int, Pose], folder: Path) -> None:
    """Write pictures of a recorded flight into `folder`: its middle photograph, and its skin.

    `poses` are the cameras' by the skin, put onto the true one, by the clouds' stamps.
    """
    photographs = list(bag.messages(['/camera/image_raw']))
    message = deserialize_message(photographs[len(photographs) // 2].data, Image)
    write_png(folder / 'camera.png', image_from_message(message)[..., ::-1])
    every = []
    for stamp, cloud in clouds_of(bag):
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
