"""The camera's side of MAVLink's camera protocol: what it is, when to shoot, what was shot.

The autopilot and the ground station may command it: MAV_CMD_IMAGE_START_CAPTURE for one image at
a time, and MAV_CMD_REQUEST_MESSAGE or MAV_CMD_REQUEST_CAMERA_INFORMATION for CAMERA_INFORMATION.
Of every image it tells CAMERA_IMAGE_CAPTURED.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from ftp_dent_ros.navigation import frames
from ftp_dent_ros.navigation.accuracy import Tag
from ftp_dent_ros.navigation.geodesy import Origin
from ftp_dent_ros.pose import Pose

COMPONENT = mavlink.MAV_COMP_ID_CAMERA
_CAPTURE = mavlink.MAV_CMD_IMAGE_START_CAPTURE
_REQUESTS = (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION)
_INFORMATION = mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION
# Forward, left and up of the camera in its optical frame.
_OPTICAL_FROM_FLU = Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
_BOOT_MS = 2**32


class Camera:
    """One camera, component 100 of the vehicle.

    Parameters
    ----------
    ground_station : int
        System that may command it, besides the autopilot.
    shoot : callable
        Takes a photograph soon; False if that is not possible now.
    """

    def __init__(self, ground_station: int, shoot: Callable[[], bool]) -> None:
        self._ground_station, self._shoot = ground_station, shoot
        self._last: tuple[int, int, float] | None = None
        self._images = 0

    def answers(
        self, command: Any, autopilot: tuple[int, int], size: tuple[int, int], boot_ms: int
    ) -> list[Any]:
        """Do what a COMMAND_LONG says; the messages to send back.

        `size` is that of the images, 0 if not known yet; `boot_ms` the autopilot's time.
        """
        source = (command.get_srcSystem(), command.get_srcComponent())
        if command.target_component not in (COMPONENT, 0):
            return []
        if source != autopilot and source[0] != self._ground_station:
            return []
        if command.command == _CAPTURE:
            return [_ack(command, source, self._capture(command, source))]
        is_request = command.command in _REQUESTS
        is_message = command.command == mavlink.MAV_CMD_REQUEST_MESSAGE
        wanted = _INFORMATION if is_message else 1
        if is_request and command.param1 == wanted:
            information = _information(size, boot_ms)
            return [_ack(command, source, mavlink.MAV_RESULT_ACCEPTED), information]
        if command.target_component == 0:
            return []  # It may be meant for another component.
        return [_ack(command, source, mavlink.MAV_RESULT_UNSUPPORTED)]

    def captured(
        self, stamp: int, tag: Tag | None, mount: Pose, origin: Origin | None, is_good: bool = True
    ) -> Any:
        """CAMERA_IMAGE_CAPTURED of an image.

        Parameters
        ----------
        stamp : int
            ROS time of its exposure, nanoseconds.
        tag : Tag or None
            Where the vehicle was; without it position and attitude say that they are not known.
        mount : Pose
            Of the camera's optical frame on the vehicle.
        origin : Origin or None
            The map's; without it latitude and longitude are 0.
        is_good : bool
            Whether there is an image at all.
        """
        place, up, boot_ms, quaternion = Origin(0.0, 0.0, 0.0), 0.0, 0, np.full(4, math.nan)
        if tag is not None:
            in_map = tag.pose @ mount
            up, boot_ms = float(in_map.translation[2]), tag.boot // 1_000_000 % _BOOT_MS
            forward_left_up = in_map.rotation * _OPTICAL_FROM_FLU
            quaternion = frames.ned_attitude(forward_left_up.as_quat())
            if origin is not None:
                place = origin.moved(in_map.translation)
        index, self._images = self._images, self._images + is_good
        return mavlink.MAVLink_camera_image_captured_message(
            time_boot_ms=boot_ms,
            time_utc=stamp // 1000,
            camera_id=1,
            lat=round(1e7 * place.latitude),
            lon=round(1e7 * place.longitude),
            alt=round(1e3 * place.above_sea),
            relative_alt=round(1e3 * up),
            q=quaternion.tolist(),
            image_index=index,
            capture_result=int(is_good),
            file_url=b'',
        )

    def _capture(self, command: Any, source: tuple[int, int]) -> int:
        if command.param3 != 1:
            return int(mavlink.MAV_RESULT_DENIED)
        # A command that was sent twice is one photograph.
        this = (*source, command.param4)
        if command.param4 > 0 and this == self._last:
            return int(mavlink.MAV_RESULT_ACCEPTED)
        if not self._shoot():
            return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        self._last = this
        return int(mavlink.MAV_RESULT_ACCEPTED)


def _ack(command: Any, source: tuple[int, int], result: int) -> Any:
    return mavlink.MAVLink_command_ack_message(
        command.command, result, target_system=source[0], target_component=source[1]
    )


def _information(size: tuple[int, int], boot_ms: int) -> Any:
    return mavlink.MAVLink_camera_information_message(
        time_boot_ms=boot_ms % _BOOT_MS,
        vendor_name=list(b'ftp_dent_ros'.ljust(32, b'\0')),
        model_name=list(b'fringe projection'.ljust(32, b'\0')),
        firmware_version=0,
        focal_length=math.nan,
        sensor_size_h=math.nan,
        sensor_size_v=math.nan,
        resolution_h=size[0],
        resolution_v=size[1],
        lens_id=0,
        flags=mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE,
        cam_definition_version=0,
        cam_definition_uri=b'',
    )
