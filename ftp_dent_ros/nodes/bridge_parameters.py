"""The parameters of the bridge to the autopilot."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ftp_dent_ros.navigation import pose_covariance
from ftp_dent_ros.navigation.pose_covariance import Covariance
from ftp_dent_ros.navigation.settings import MOST_CLOCK_ERROR, VehicleSettings
from ftp_dent_ros.navigation.signing import read_key
from ftp_dent_ros.parameters import Declarations
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig


@dataclass(frozen=True)
class BridgeParameters:
    """What mavlink_bridge was given; the timeout in seconds."""

    address: str
    baud: int
    signing_key: bytes
    settings: VehicleSettings
    timeout: float
    most_waiting: int
    map_frame: str
    base_frame: str
    camera_frame: str
    mount: Pose
    mount_covariance: Covariance
    publishes_tf: bool
    ground_station: int
    image_size: tuple[int, int]
    preview_columns: int


def declare(parameters: Declarations) -> BridgeParameters:
    """Declare them; ``pose_timeout`` changes while it runs."""
    address, baud, signing_key = declare_link(parameters)
    map_frame, base_frame, camera_frame = declare_frames(parameters)
    mount, mount_covariance = declare_mount(parameters)
    ground_station, image_size = declare_camera(parameters)
    return BridgeParameters(
        address=address,
        baud=baud,
        signing_key=signing_key,
        settings=declare_settings(parameters),
        timeout=parameters.declare(
            'pose_timeout',
            1.0,
            'How long a cloud waits for its pose, seconds.',
            minimum=0.0,
            maximum=60.0,
            changeable=True,
        ),
        most_waiting=parameters.declare(
            'queue_size', 5, 'How many clouds may wait at once.', minimum=1, maximum=1000
        ),
        map_frame=map_frame,
        base_frame=base_frame,
        camera_frame=camera_frame,
        mount=mount,
        mount_covariance=mount_covariance,
        publishes_tf=parameters.declare(
            'publish_tf', True, 'Whether poses and mount also go to TF, where tf2_msgs exists.'
        ),
        ground_station=ground_station,
        image_size=image_size,
        preview_columns=parameters.declare(
            'preview_columns',
            320,
            'Largest width of the clouds of tagged/preview, points.',
            minimum=16,
            maximum=1920,
        ),
    )


def declare_link(parameters: Declarations) -> tuple[str, int, bytes]:
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
    key_file = parameters.file(
        'signing_key',
        '',
        'File with the key of MAVLink signing, 32 bytes or 64 hexadecimal digits; what is not '
        'signed with it is refused. Without it nothing is signed.',
        secret=True,
    )
    signing_key = read_key(str(key_file)) if key_file else b''
    return address, baud, signing_key


def declare_settings(parameters: Declarations) -> VehicleSettings:
    """Whom to believe and what to ask for, from parameters."""
    default = VehicleSettings()
    return VehicleSettings(
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
            maximum=MOST_CLOCK_ERROR,
        ),
        earth=parameters.declare(
            'earth',
            default.earth,
            "Whether the map's origin on the earth goes to the topic earth.",
        ),
        position_source=parameters.declare(
            'position_source',
            default.position_source,
            'What the autopilot navigates by: gps, which is watched then (no tag without a new '
            'and good fix), or other (vision, motion capture).',
            choices=('gps', 'other'),
        ),
        height_scale_uncertainty=parameters.declare(
            'height_scale_uncertainty',
            default.height_scale_uncertainty,
            "Standard deviation of height as a share of the height above the map's origin; 0 "
            'where it does not come from a barometer.',
            minimum=0.0,
            maximum=1.0,
        ),
    )


def declare_frames(parameters: Declarations) -> tuple[str, str, str]:
    """Names of the map, the base and the camera frame, from parameters."""
    return (
        parameters.declare('map_frame', 'map', "The map: ENU about the estimator's origin."),
        parameters.declare('base_frame', 'base_link', "The vehicle's body: FLU."),
        parameters.declare(
            'camera_frame', 'camera_optical_frame', 'The frame that clouds come in.'
        ),
    )


def declare_mount(parameters: Declarations) -> tuple[Pose, Covariance]:
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
    uncertainty = pose_covariance.of_mount(
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


def declare_camera(parameters: Declarations) -> tuple[int, tuple[int, int]]:
    """System that may command the camera over MAVLink, and the size of its images.

    0 if there is no camera to command; 0, 0 if the size is not known yet.
    """
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
    rig = parameters.file(
        'rig',
        '',
        "Calibration file (rig.yaml): of what size the camera's images are, for the MAVLink side; "
        'without it that is known with the first image.',
    )
    camera = read_rig(rig).camera if rig else None
    size = (0, 0) if camera is None else (camera.width, camera.height)
    return (station if is_enabled else 0), size
