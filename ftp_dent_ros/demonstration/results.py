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

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.ply import write_ply
from ftp_dent_ros.coding.images import image_from_message
from ftp_dent_ros.demonstration.appraisal import (
    Appraisal,
    DentAppraisal,
    SkinAppraisal,
    camera_error,
    clouds_of,
    image_at,
    map_error,
    mean_absolute,
)
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.clouds import rig_id_of
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.simulation.surface import Surface
from ftp_dent_ros.simulation.world import World

_NOTHING = '0.85'
_MM = 1000.0

# First, middle and last are enough to look at; the bag has them all.
_KEPT = 3
# As many points as a 3-D picture of this size can show.
_SHOWN = 120_000

# What the payload promises in this simulation: how many, and millimetres.
BOUNDS = {
    'images_lost': 0,
    'clouds_lost': 0,
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
        with written_aside(folder / 'camera.png') as aside:
            cv2.imwrite(str(aside), image)
        progress()
    for topic, frame in (('/points', 'camera'), ('/tagged/points', 'map')):
        cloud = next(cloud for stamp, cloud in clouds_of(bag, topic) if stamp == stamp_ns)
        if frame == 'camera':
            error = camera_error(world, cloud, stamp_ns)
            depth_map(folder / 'depth.png', cloud)
            progress()
        else:
            error = map_error(world, cloud)
        title = f'Error in the {frame} frame, MAE {mean_absolute(error):.4f} mm'
        error_map(folder / f'error_{frame}.png', error, title)
        progress()


def _picture_of_all(bag: Bag, world: World, poses: Mapping[int, Pose], folder: Path) -> None:
    """The measured skin along the flight, coloured by how deep it lies behind the undented one."""
    every = []
    for stamp, cloud in clouds_of(bag, '/points'):
        if stamp in poses:
            points = cloud.points[cloud.valid].astype(np.float64)
            step = max(1, len(points) * len(poses) // _SHOWN)
            every.append(poses[stamp].apply(points[::step]))
    skin = np.concatenate(every)
    undented = Surface(tuple(replace(panel, dents=()) for panel in world.surface.panels))
    flight = [world.base_pose(stamp) for stamp in poses]
    view_3d(folder / 'view_3d.png', skin, undented.distance(skin), flight)


def summary_of(appraisal: Appraisal, dents: DentAppraisal, skin: SkinAppraisal) -> str:
    """The figures as people read them, a line each."""
    a, d, s = appraisal, dents, skin
    rows = [
        ('images', f'{a.images}, lost {a.images_lost}{_too_slow(a.images_not_taken, "taken")}'),
        ('clouds', f'{a.clouds}, lost {a.clouds_lost}'),
        (
            'tagged clouds',
            f'{a.tagged_clouds}, lost {a.tagged_clouds_lost}'
            f'{_too_slow(a.tagged_clouds_late, "tagged")}',
        ),
        ('autopilot poses', f'{a.poses}, lost {a.poses_lost}{_too_slow(a.poses_not_had, "had")}'),
        (
            'exposure to tagged cloud',
            f'{a.latency_median_ms:.0f} ms median, {a.latency_maximum_ms:.0f} ms at most',
        ),
        (
            'MAE in the camera frame',
            f'{a.camera_mae_mm:.4f} mm, worst cloud {a.camera_mae_worst_mm:.4f} mm '
            f'(bound {BOUNDS["camera_mae_mm"]} mm)',
        ),
        (
            "by the autopilot's poses",
            f'{a.map_mae_mm:.1f} mm in the map, worst cloud {a.map_mae_worst_mm:.1f} mm '
            f'(bound {BOUNDS["map_mae_mm"]:g} mm)',
        ),
        (
            "by the skin's own poses",
            f'{s.skin_mae_mm:.4f} mm against itself, worst cloud {s.skin_mae_worst_mm:.4f} mm '
            f'(bound {BOUNDS["skin_mae_mm"]} mm)',
        ),
        (
            'the skin',
            f'points {s.skin_place_mm:.3f} mm from their places on it, the whole '
            f'{s.skin_off_mm:.0f} mm off in the map'
            + (f'; {s.skin_parts} parts' if s.skin_parts > 1 else ''),
        ),
        ('clouds not inspected', f'{d.clouds_not_inspected}'),
        (
            'true dents in view',
            f'{d.dents}, missed {d.dents_missed}, false {d.dents_false}, twice {d.dents_twice}',
        ),
        ('their sightings', f'{d.sightings}, missed {d.sightings_missed}'),
        (
            'largest error of a dent',
            f'depth {d.depth_error_mm:.3f} mm, length {d.length_error_mm:.2f} mm, '
            f'width {d.width_error_mm:.2f} mm',
        ),
        ('listed as others', f'{d.others}, where there is none {d.others_false}'),
        (
            "dents in the node's list",
            f'{d.dents_in_list}, false {d.dents_false_in_list}, twice {d.dents_twice_in_list}',
        ),
    ]
    return '\n'.join(f'{name:26}{value}' for name, value in rows)


def _too_slow(count: int, what: str) -> str:
    """What this machine could not do in time: no fault of the payload, but worth to be known."""
    return f'; {count} more not {what} in time, for this machine is too slow' if count else ''
