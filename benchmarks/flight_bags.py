"""Bags of simulated flights, made without nodes: photographed, reconstructed and recorded.

python benchmarks/flight_bags.py FOLDER [--clouds 41] [--seed 1]

The photographs are those of the shipped scene's camera, a cloud every half a second; their poses
are the autopilot's with the errors of the scene.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from tqdm import tqdm

from ftp_dent_ros.errors import RefusedFrameError
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.recording.clouds import CAMERA_POSE, PHOTOGRAPHS, POINTS, SKIN
from ftp_dent_ros.recording.topic import Message, Qos, RecordedTopic, find_definition, type_hash
from ftp_dent_ros.recording.writer import BagWriter
from ftp_dent_ros.rig.rig import Rig, read_rig
from ftp_dent_ros.ros.messages import (
    cloud_to_message,
    image_to_message,
    make_header,
    pose_to_message,
)
from ftp_dent_ros.simulation.flight import EstimateErrors
from ftp_dent_ros.simulation.world import World, read_world

# Of the shipped simulation.
EVERY_NS = 500_000_000
START_NS = 1_760_000_000_000_000_000
STRIDE = 2
# What a real ArduCopter was off by on a slow flight: 2.6 cm root mean square, 0.5 degrees.
ERRING = EstimateErrors(wander=(0.055, 0.055, 0.055), lag=0.02, yaw=0.01, yaw_wander=0.01)
# What its pose states: metres and radians, standard deviations.
STATED = np.diag([0.03**2] * 3 + [0.015**2] * 3)
_TYPES = {
    PHOTOGRAPHS: 'sensor_msgs/msg/Image',
    SKIN: 'sensor_msgs/msg/Image',
    POINTS: 'sensor_msgs/msg/PointCloud2',
    CAMERA_POSE: 'geometry_msgs/msg/PoseWithCovarianceStamped',
}
# Stamp of a photograph (ns), the photograph, and the camera's pose as the autopilot says.
Taken = tuple[int, NDArray[np.uint8], Pose]


def record_flight(
    folder: Path,
    world: World,
    stamps_ns: Iterable[int],
    rig: Rig | None = None,
    pattern: Pattern | None = None,
    covariance: NDArray[np.float64] = STATED,
) -> Path:
    """Photograph a world at each stamp, reconstruct, and write it all as a bag."""
    rig = rig or read_rig(find('shipped:rig.yaml'))
    pattern = pattern or read_pattern(find('shipped:pattern.yaml'))
    projected = pattern.draw()

    def taken() -> Iterator[Taken]:
        for stamp in stamps_ns:
            seconds = world.flight_time(stamp)
            pose = world.errors.estimated(world.flight, seconds) @ world.mount
            yield stamp, world.photograph(rig, projected, stamp), pose

    return record(folder, taken(), rig, pattern, covariance)


def record(
    folder: Path,
    taken: Iterable[Taken],
    rig: Rig,
    pattern: Pattern,
    covariance: NDArray[np.float64] = STATED,
) -> Path:
    """Reconstruct photographs, and write them with all that is made of them as a bag."""
    reconstructor = Reconstructor(rig, pattern, Settings(stride=STRIDE))
    with BagWriter(folder) as writer:
        for name, kind in _TYPES.items():
            hash_ = type_hash(kind)
            writer.add_topic(
                RecordedTopic(name, kind, hash_, (Qos(),), find_definition(kind, hash_))
            )
        for stamp, image, pose in taken:
            try:
                measured = reconstructor.measure(image, skin=True)
            except RefusedFrameError:
                continue
            contents = {
                PHOTOGRAPHS: image_to_message(image, stamp, 'camera_optical_frame'),
                SKIN: image_to_message(measured.cloud.skin, stamp, 'camera_optical_frame'),
                POINTS: cloud_to_message(measured.cloud, stamp, 'camera_optical_frame'),
                CAMERA_POSE: located(pose, covariance, stamp),
            }
            writer.write(
                Message(name, _TYPES[name], stamp, stamp, serialize_message(content))
                for name, content in contents.items()
            )
    return folder


def located(
    pose: Pose, covariance: NDArray[np.float64], stamp_ns: int
) -> PoseWithCovarianceStamped:
    """geometry_msgs/PoseWithCovarianceStamped in the map."""
    message = PoseWithCovarianceStamped(header=make_header(stamp_ns, 'map'))
    message.pose.pose = pose_to_message(pose)
    message.pose.covariance = np.asarray(covariance, float).ravel()
    return message


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('folder', type=Path)
    parser.add_argument('--clouds', type=int, default=41)
    parser.add_argument('--seed', type=int, default=1, help="of the camera's noise")
    arguments = parser.parse_args()
    world = replace(read_world('shipped:scene.yaml', START_NS), errors=ERRING, seed=arguments.seed)
    stamps = [START_NS + EVERY_NS * (index + 1) for index in range(arguments.clouds)]
    record_flight(arguments.folder, world, tqdm(stamps, unit='photograph'))


if __name__ == '__main__':
    main()
