"""The parameters of the bridge to the autopilot."""

from __future__ import annotations

import math

from ftp_dent_ros.navigation import accuracy
from ftp_dent_ros.navigation.accuracy import Covariance
from ftp_dent_ros.navigation.codec import read_key
from ftp_dent_ros.navigation.vehicle_state import Settings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.parameters import Parameters


def declare_link(parameters: Parameters) -> tuple[str, int, bytes]:
    """Address, baud rate and signing key, from parameters."""
    address = parameters.declare(
        'address',
        'udpin:127.0.0.1:14550',
        'The autopilot: udpin:HOST:PORT (listens; on 127.0.0.1 without HOST), '
        'udpout:HOST:PORT (sends first), tcp:HOST:PORT, or the path of a serial device.',
    )
    baud = parameters.declare(
        'baud', 921600, 'Baud rate of a serial device.', minimum=1200, maximum=4_000_000
    )
    key_file = parameters.declare(
        'signing_key',
        '',
        'File with the key of MAVLink signing, 32 bytes or 64 hexadecimal digits; what is not '
        'signed with it is refused. Without it nothing is signed.',
    )
    signing_key = read_key(key_file) if key_file else b''
    return address, baud, signing_key


def declare_settings(parameters: Parameters) -> Settings:
    """Whom to believe and what to ask for, from parameters."""
    default = Settings()
    return Settings(
        system_id=parameters.declare(
            'system_id',
            default.system_id,
            'MAVLink system id of the autopilot; 0 for the first that is heard.',
            minimum=0,
            maximum=255,
        ),
        component_id=parameters.declare(
            'component_id',
            default.component_id,
            'MAVLink component id of the autopilot.',
            minimum=1,
            maximum=255,
        ),
        rate=parameters.declare(
            'rate',
            default.rate,
            'Rate at which attitude and position are asked for, Hz.',
            minimum=10.0,
            maximum=200.0,
        ),
        maximum_gap=parameters.declare(
            'maximum_gap',
            default.maximum_gap,
            'Longest time between two samples across which a pose is interpolated, seconds.',
            minimum=0.01,
            maximum=1.0,
        ),
        maximum_clock_error=parameters.declare(
            'maximum_clock_error',
            default.maximum_clock_error,
            "Largest uncertainty of the autopilot's clock at which a cloud is tagged, seconds.",
            minimum=0.0001,
            maximum=1.0,
        ),
        earth=parameters.declare(
            'earth',
            default.earth,
            "Whether the map's origin on the earth goes to the topic earth.",
        ),
    )


def declare_frames(parameters: Parameters) -> tuple[str, str, str]:
    """Names of the map, the base and the camera frame, from parameters."""
    return (
        parameters.declare('map_frame', 'map', "The map: ENU about the estimator's origin."),
        parameters.declare('base_frame', 'base_link', "The vehicle's body: FLU."),
        parameters.declare(
            'camera_frame', 'camera_optical_frame', 'The frame that clouds come in.'
        ),
    )


def declare_mount(parameters: Parameters) -> tuple[Pose, Covariance]:
    """Pose of the camera on the vehicle and its covariance; by default it looks forward."""
    translation = parameters.declare(
        'mount.translation',
        [0.1, 0.0, 0.0],
        'Position of the camera in the base frame: forward, left, up, metres.',
        minimum=-100.0,
        maximum=100.0,
    )
    rpy = parameters.declare(
        'mount.rpy',
        [-math.pi / 2, 0.0, -math.pi / 2],
        "Roll, pitch, yaw of the camera's optical frame in the base frame, radians.",
        minimum=-2 * math.pi,
        maximum=2 * math.pi,
    )
    uncertainty = accuracy.of_mount(
        parameters.declare(
            'mount.translation_uncertainty',
            0.005,
            'Standard deviation of mount.translation along each axis, metres.',
            minimum=0.0,
            maximum=100.0,
        ),
        parameters.declare(
            'mount.rotation_uncertainty',
            0.01,
            'Standard deviation of mount.rpy about each axis, radians.',
            minimum=0.0,
            maximum=math.pi,
        ),
    )
    return Pose.from_rpy(rpy, translation), uncertainty


def declare_ground_station(parameters: Parameters) -> int:
    """System that may command the camera over MAVLink; 0 if there is no camera to command."""
    is_enabled = parameters.declare(
        'camera.enabled',
        False,
        'Whether the payload is a camera on the MAVLink side, too: tells of each photograph, and '
        'takes one when the ground station or the autopilot commands it.',
    )
    station = parameters.declare(
        'camera.ground_station',
        255,
        'MAVLink system id of the ground station that may command photographs.',
        minimum=1,
        maximum=255,
    )
    return station if is_enabled else 0
