"""Opens a V4L2 camera through OpenCV, with a fixed size, exposure and gain."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ftp_dent_ros.capture.raw_formats import V4L2, RawFormat
from ftp_dent_ros.errors import CameraError, ConfigurationError
from ftp_dent_ros.photograph.photograph import Photograph

# OpenCV's V4L2 backend delivers these with red and blue swapped in some versions: the red
# stripe would be blue.
_SWAPPED = ('NV12', 'NV21')


@dataclass(frozen=True)
class DeviceSettings:
    """What is asked of a V4L2 camera.

    Attributes
    ----------
    path : str
        Device file; a link under ``/dev/v4l/by-id`` names the same camera on every port.
    width, height : int
        Image size, pixels.
    rate : float
        Images a second asked of the driver; below 1 leaves it as it is.
    fourcc : str
        Pixel format of V4L2, of four characters ('MJPG', 'YUYV', 'GREY', 'Y12 ', 'RG12'); empty
        leaves it as it is.
    exposure : float
        Seconds; 0 leaves it as it is.
    gain : float
        In the driver's unit; negative leaves it as it is.

    Raises
    ------
    ConfigurationError
        A value is impossible.
    """

    path: str
    width: int
    height: int
    rate: float = 0.0
    fourcc: str = ''
    exposure: float = 0.0
    gain: float = -1.0

    def __post_init__(self) -> None:
        if len(self.fourcc) not in (0, 4) or not self.fourcc.isascii():
            raise ConfigurationError(
                f'the pixel format {self.fourcc!r} has not four characters: '
                'v4l2-ctl --list-formats shows what the camera has'
            )
        if self.fourcc in _SWAPPED:
            raise ConfigurationError(
                f'the pixel format {self.fourcc} comes with its colours swapped: use MJPG or YUYV'
            )


class RawCapture:
    """A camera whose pixels come as its sensor has them, with `cv2.VideoCapture`'s methods.

    Parameters
    ----------
    capture : cv2.VideoCapture
        Open and set up.
    form : RawFormat
    size : (int, int)
        Width and height, pixels.
    """

    def __init__(self, capture: Any, form: RawFormat, size: tuple[int, int]) -> None:
        self._capture, self._form, self._size = capture, form, size
        self.grab, self.get, self.release = capture.grab, capture.get, capture.release

    def retrieve(self) -> tuple[bool, Photograph | None]:
        """Whether a frame was grabbed, and the frame."""
        good, data = self._capture.retrieve()
        if not good:
            return False, None
        # OpenCV gives the driver's bytes in one shape or another.
        flat = np.ascontiguousarray(data).reshape(-1).view(np.uint8)
        return True, self._form.photograph(flat, *self._size)


def open_device(settings: DeviceSettings) -> cv2.VideoCapture | RawCapture:
    """Open and set up a camera.

    Raises
    ------
    CameraError
        It is not there, is not ours, or does not take what is asked of it.
    """
    path = settings.path
    if not os.path.exists(path):
        raise CameraError(f'{path} does not exist: plug the camera in or name another device')
    if not os.access(path, os.R_OK | os.W_OK):
        raise CameraError(f'{path} may not be opened: add this user to the group video')
    capture = cv2.VideoCapture(path, cv2.CAP_V4L2)
    try:
        if not capture.isOpened():
            raise CameraError(
                f'{path} cannot be opened as a camera: end the program that uses it, or name '
                'another device of the camera (often the first of two)'
            )
        taken = _set_up(capture, settings)
    except BaseException:
        capture.release()
        raise
    if taken in V4L2:
        return RawCapture(capture, V4L2[taken], (settings.width, settings.height))
    return capture


def _set_up(capture: cv2.VideoCapture, settings: DeviceSettings) -> str:
    """Ask for the settings; the pixel format that is taken."""
    if settings.fourcc in V4L2:
        # As the sensor has them: OpenCV's conversion keeps eight bits.
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    # The order matters: each format has its own sizes, each size its own rates.
    if settings.fourcc:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*settings.fourcc))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.height)
    if settings.rate >= 1:
        capture.set(cv2.CAP_PROP_FPS, settings.rate)
    size = tuple(
        int(capture.get(which)) for which in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    if size != (settings.width, settings.height):
        raise CameraError(
            f'{settings.path} gives {size[0]}x{size[1]} pixels where '
            f'{settings.width}x{settings.height} were asked for: '
            'v4l2-ctl --list-formats-ext shows what the camera has'
        )
    taken = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, 'little').decode('latin-1')
    if taken in _SWAPPED or (settings.fourcc and taken != settings.fourcc):
        raise CameraError(
            f'{settings.path} gives the pixel format {taken!r}: ask for another, '
            'v4l2-ctl --list-formats shows what the camera has'
        )
    if settings.exposure > 0:
        # A value of V4L2_CID_EXPOSURE_AUTO, and the unit of V4L2_CID_EXPOSURE_ABSOLUTE.
        _set(capture, settings, cv2.CAP_PROP_AUTO_EXPOSURE, 1, 'a fixed exposure')
        _set(
            capture,
            settings,
            cv2.CAP_PROP_EXPOSURE,
            max(1, round(settings.exposure / 100e-6)),
            f'an exposure of {settings.exposure:g} s',
        )
    if settings.gain >= 0:
        _set(capture, settings, cv2.CAP_PROP_GAIN, settings.gain, f'a gain of {settings.gain:g}')
    if taken in V4L2:
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return taken


def _set(
    capture: cv2.VideoCapture, settings: DeviceSettings, what: int, value: float, name: str
) -> None:
    """Set a control, and make sure that the driver took it."""
    # A driver may round to its own steps.
    if not capture.set(what, value) or abs(capture.get(what) - value) > max(0.5, 0.05 * value):
        raise CameraError(
            f'{settings.path} does not take {name} (it has {capture.get(what):g} in its own unit '
            f'where {value:g} was set): v4l2-ctl --list-ctrls shows the range'
        )
