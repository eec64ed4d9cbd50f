"""The camera's side of MAVLink's camera protocol: what it is, when to shoot, what was shot.

The autopilot and the ground station may command it: MAV_CMD_IMAGE_START_CAPTURE for one image at
a time (as of ArduPilot's CAM1_TYPE 6, which wants CAMERA_INFORMATION before), and
MAV_CMD_REQUEST_MESSAGE, or the commands that it has replaced, for CAMERA_INFORMATION and
CAMERA_CAPTURE_STATUS; the autopilot also MAV_CMD_DO_DIGICAM_CONTROL (CAM1_TYPE 5). Of every image
it sends CAMERA_IMAGE_CAPTURED.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from ftp_dent_ros.navigation import frames
from ftp_dent_ros.navigation.origin import Origin
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.pose import Pose

COMPONENT = mavlink.MAV_COMP_ID_CAMERA
_ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
_DIGICAM = mavlink.MAV_CMD_DO_DIGICAM_CONTROL
_INFORMATION = mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION
_STATUS = mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS
# Latitude, longitude and altitudes that are not known, as CAMERA_FOV_STATUS of the same service
# has them: 0, 0 is a place.
_UNKNOWN = 2**31 - 1
# The same number of the same client's again after as long is a new command, milliseconds: an
# autopilot counts from 1 again after a reboot.
_REPEATED_MS = 10_000
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
        self._last: tuple[tuple[int, int, float] | None, int] = None, 0
        self._images = 0

    def answers(
        self, command: Any, autopilot: tuple[int, int], size: tuple[int, int], boot_ms: int
    ) -> list[Any]:
        """Do what a COMMAND_LONG says; the messages to send back.

        `size` is that of the images, 0 if not known yet; `boot_ms` the autopilot's time.
        """
        source = (command.get_srcSystem(), command.get_srcComponent())
        is_ours = command.target_component == COMPONENT
        if not (is_ours or command.target_component == 0):
            return []
        if source != autopilot and source[0] != self._ground_station:
            return []
        number, answers = command.command, []
        if number == mavlink.MAV_CMD_IMAGE_START_CAPTURE:
            result = self._capture(command, source, boot_ms)
        # Not a shot that the autopilot got as well and passes on.
        elif number == _DIGICAM and command.param5 == 1 and (is_ours or source == autopilot):
            result = self._result()
        elif _asks(command, _INFORMATION, mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION):
            result, answers = _ACCEPTED, [self.information(size, boot_ms)]
        elif _asks(command, _STATUS, mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS):
            # Never busy, for a command of its own is a photograph each.
            status = mavlink.MAVLink_camera_capture_status_message(
                time_boot_ms=boot_ms % _BOOT_MS,
                image_status=0,
                video_status=0,
                image_interval=0.0,
                recording_time_ms=0,
                available_capacity=0.0,
                image_count=self._images,
            )
            result, answers = _ACCEPTED, [status]
        elif is_ours:
            result = mavlink.MAV_RESULT_UNSUPPORTED
        else:
            return []  # It may be meant for another component.
        ack = mavlink.MAVLink_command_ack_message(
            number, result, target_system=source[0], target_component=source[1]
        )
        return [ack, *answers]

    def information(self, size: tuple[int, int], boot_ms: int) -> Any:
        """CAMERA_INFORMATION, with the size of the images (0 if not known yet)."""
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
            The map's; without it latitude, longitude and altitude are unknown.
        is_good : bool
            Whether there is an image at all.
        """
        latitude = longitude = above_sea = above_origin = _UNKNOWN
        boot_ms, quaternion = 0, np.full(4, math.nan)
        if tag is not None:
            in_map = tag.pose @ mount
            boot_ms = tag.boot // 1_000_000 % _BOOT_MS
            above_origin = round(1e3 * float(in_map.translation[2]))
            forward_left_up = in_map.rotation * _OPTICAL_FROM_FLU
            quaternion = frames.ned_attitude(forward_left_up.as_quat())
            if origin is not None:
                place = origin.moved(in_map.translation)
                latitude, longitude = round(1e7 * place.latitude), round(1e7 * place.longitude)
                above_sea = round(1e3 * place.above_sea)
        index, self._images = self._images, self._images + is_good
        return mavlink.MAVLink_camera_image_captured_message(
            time_boot_ms=boot_ms,
            time_utc=stamp // 1000,
            camera_id=0,  # that of a MAVLink camera, which has a component id of its own
            lat=latitude,
            lon=longitude,
            alt=above_sea,
            relative_alt=above_origin,
            q=quaternion.tolist(),
            image_index=index,
            capture_result=int(is_good),
            file_url=b'',
        )

    def _capture(self, command: Any, source: tuple[int, int], boot_ms: int) -> int:
        if command.param3 != 1:
            return mavlink.MAV_RESULT_DENIED
        # A command that was sent twice is one photograph.
        this, (last, then_ms) = (*source, command.param4), self._last
        if command.param4 > 0 and this == last and 0 <= boot_ms - then_ms < _REPEATED_MS:
            return _ACCEPTED
        result = self._result()
        if result == _ACCEPTED:
            self._last = this, boot_ms
        return result

    def _result(self) -> int:
        """Take a photograph: a MAV_RESULT."""
        return _ACCEPTED if self._shoot() else mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def _asks(command: Any, message: int, old: int) -> bool:
    """Whether a command, or the one that it has replaced, asks for the message of a number."""
    asked = {mavlink.MAV_CMD_REQUEST_MESSAGE: message, old: 1}
    return bool(asked.get(command.command) == command.param1)
