"""What a demonstration leaves to look at: clouds as PLY, and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ftp_dent_ros.cloud.ply import write_ply
from ftp_dent_ros.coding.images import image_from_message
from ftp_dent_ros.demonstration import pictures
from ftp_dent_ros.demonstration.appraisal import (
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
from ftp_dent_ros.simulation.skin.surface import Surface
from ftp_dent_ros.simulation.world import World

# First, middle and last are enough to look at; the bag has them all.
_KEPT = 3
# As many points as a 3-D picture of this size can show.
_SHOWN = 120_000


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
            pictures.depth_map(folder / 'depth.png', cloud)
            progress()
        else:
            error = map_error(world, cloud)
        title = f'Error in the {frame} frame, MAE {mean_absolute(error):.4f} mm'
        pictures.error_map(folder / f'error_{frame}.png', error, title)
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
    pictures.view_3d(folder / 'view_3d.png', skin, undented.distance(skin), flight)
