"""A camera that runs by itself, always its newest frame; a V4L2 camera through OpenCV."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.capture.raw_formats import V4L2, RawFormat
from ftp_dent_ros.capture.source import ExposureClock, Frame, Source
from ftp_dent_ros.errors import CameraError, ConfigurationError
from ftp_dent_ros.photograph.photograph import Photograph

# OpenCV's V4L2 backend delivers these with red and blue swapped in some versions: the red
# stripe would be blue.
_SWAPPED = ('NV12', 'NV21')
# Seconds between two tries to open a camera that is gone.
_PAUSE = 1.0
# Seconds without an image after which a sentence says so.
_PATIENCE = 3.0


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """What is asked of a V4L2 or GenICam camera.

    Attributes
    ----------
    path : str
        V4L2: device file; a link under ``/dev/v4l/by-id`` names the same camera on every port.
    fourcc : str
        V4L2: pixel format, of four characters ('MJPG', 'YUYV', 'GREY', 'Y12 ', 'RG12'); empty
        leaves it as it is.
    camera : str
        GenICam: name, serial number or address, as Aravis lists it; empty for the first.
    pixel_format : str
        GenICam: its name (Mono8, RGB8, BayerRG8); empty leaves it as it is.
    trigger : str
        GenICam: ``Software``, a line's name (``Line1``), or empty for none.
    width, height : int
        Image size, pixels; 0 leaves it as it is.
    device_rate : float
        Images a second asked of the driver; below 1 leaves it as it is.
    exposure : float
        Seconds; 0 leaves it as it is.
    gain : float
        In the driver's unit; negative leaves it as it is.

    Raises
    ------
    ConfigurationError
        A value is impossible.
    """

    path: str = ''
    fourcc: str = ''
    camera: str = ''
    pixel_format: str = ''
    trigger: str = ''
    width: int = 0
    height: int = 0
    device_rate: float = 0.0
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


class V4l2Capture:
    """What OpenCV gives of a camera as photographs.

    Parameters
    ----------
    capture : cv2.VideoCapture
        Open and set up.
    form : RawFormat, optional
        Of pixels that come as the sensor has them; without it they are BGR.
    size : (int, int)
        Width and height, pixels, of what has a form.
    """

    def __init__(
        self, capture: Any, form: RawFormat | None = None, size: tuple[int, int] = (0, 0)
    ) -> None:
        self._capture, self._form, self._size = capture, form, size
        self.grab, self.get, self.release = capture.grab, capture.get, capture.release

    def retrieve(self) -> Photograph | None:
        """The frame that was grabbed, if it can be read."""
        good, data = self._capture.retrieve()
        if not good:
            return None
        if self._form is None:
            return Photograph(np.asarray(cv2.cvtColor(data, cv2.COLOR_BGR2RGB), np.uint8))
        # OpenCV gives the driver's bytes in one shape or another.
        flat = np.ascontiguousarray(data).reshape(-1).view(np.uint8)
        return self._form.photograph(flat, *self._size)

    def notes(self) -> dict[str, object]:
        """Nothing: V4L2 tells nothing."""
        return {}


def open_device(settings: CameraSettings) -> V4l2Capture:
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
    return V4l2Capture(capture, V4L2.get(taken), (settings.width, settings.height))


def _set_up(capture: cv2.VideoCapture, settings: CameraSettings) -> str:
    """Ask for the settings; the pixel format that is taken."""
    if settings.fourcc in V4L2:
        # As the sensor has them: OpenCV's conversion keeps eight bits.
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    # The order matters: each format has its own sizes, each size its own rates.
    if settings.fourcc:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*settings.fourcc))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.height)
    if settings.device_rate >= 1:
        capture.set(cv2.CAP_PROP_FPS, settings.device_rate)
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
    exposure, gain = settings.exposure, settings.gain
    # A value of V4L2_CID_EXPOSURE_AUTO, and the unit of V4L2_CID_EXPOSURE_ABSOLUTE.
    manual, units = 1, max(1, round(exposure / 100e-6))
    for is_asked, what, value, name in (
        (exposure > 0, cv2.CAP_PROP_AUTO_EXPOSURE, manual, 'a fixed exposure'),
        (exposure > 0, cv2.CAP_PROP_EXPOSURE, units, f'an exposure of {exposure:g} s'),
        (gain >= 0, cv2.CAP_PROP_GAIN, gain, f'a gain of {gain:g}'),
    ):
        # A driver may round to its own steps.
        near = max(0.5, 0.05 * value)
        if is_asked and not (capture.set(what, value) and abs(capture.get(what) - value) <= near):
            raise CameraError(
                f'{settings.path} does not take {name} (it has {capture.get(what):g} in its own '
                f'unit where {value:g} was set): v4l2-ctl --list-ctrls shows the range'
            )
    if taken in V4L2:
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return taken


class _Due:
    """Which of a camera's frames are due at a rate below its own."""

    def __init__(self, rate: float) -> None:
        self._period_ns = round(1e9 / rate) if rate > 0 else 0
        self._next_ns = self._last_ns = 0

    def at(self, stamp_ns: int) -> bool:
        # Half the camera's interval of tolerance: one just slower than the rate loses no frame.
        tolerance_ns = (stamp_ns - (self._last_ns or stamp_ns)) // 2
        self._last_ns = stamp_ns
        due_ns = self._next_ns or stamp_ns
        if not self._period_ns or stamp_ns < due_ns - tolerance_ns:
            return False
        self._next_ns = max(due_ns + self._period_ns, stamp_ns + self._period_ns // 2)
        return True


class DeviceSource(Source):
    """Frames of a camera that is opened again whenever it fails.

    A thread takes every image from the driver, so that none grows old in its queue, and decodes
    those that are due. A frame whose time is not later than that of the one before, or whose
    pixels are the same (OpenCV repeats the last image when a JPEG is damaged), is left out.

    Parameters
    ----------
    open_capture : callable
        Opens the camera, or raises `CameraError`; what it gives has `V4l2Capture`'s methods.
    rate : float
        Frames a second, if the camera gives more; 0 for none unless asked for.
    clock : ExposureClock
    now_ns : callable
        ROS time, nanoseconds.
    pause : float
        Seconds before an attempt to open the camera again.
    """

    runs_by_itself = True

    def __init__(
        self,
        open_capture: Callable[[], Any],
        rate: float,
        clock: ExposureClock,
        now_ns: Callable[[], int],
        pause: float = _PAUSE,
    ) -> None:
        self._notes: dict[str, Any] = {
            'times opened': 0,
            'repeated images left out': 0,
            'kernel time stamps': False,
        }
        self._notes_of_camera: Callable[[], dict[str, object]] = dict
        self._open_capture = open_capture
        self._rate = rate
        self._clock = clock
        self._now_ns = now_ns
        self._pause = pause
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._wanted_after_ns = math.inf
        self._trouble = ''
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='camera', daemon=True)
        self._thread.start()

    def notes(self) -> dict[str, object]:
        """How the camera does."""
        return {**self._notes, **self._notes_of_camera()}

    def next_frame(self, timeout: float) -> Frame | None:
        """Newest frame that was due and was not given before; None if there is none in time."""
        return self._take(timeout, 0)

    def shoot(self) -> Frame:
        """Frame whose exposure began after this call."""
        after_ns = self._now_ns() + round(self._clock.exposure / 2 * 1e9)
        self._wanted_after_ns = after_ns
        frame = self._take(_PATIENCE, after_ns)
        if frame is None:
            raise CameraError(f'the camera gave no image for {_PATIENCE:g} s: check its cable')
        return frame

    def close(self) -> None:
        """Stop the thread and let go of the camera."""
        self._stop.set()
        # A driver that hangs is not waited for: the thread touches nothing but the camera.
        self._thread.join(timeout=1.0)

    def _take(self, timeout: float, after_ns: int) -> Frame | None:
        def ready() -> bool:
            newest = self._newest
            return bool(self._trouble) or (newest is not None and newest.stamp_ns >= after_ns)

        with self._changed:
            self._changed.wait_for(ready, timeout)
            frame, self._newest = self._newest, None
            if frame is not None and frame.stamp_ns >= after_ns:
                return frame
            if self._trouble:
                raise CameraError(self._trouble)
            return None

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                capture = self._open_capture()
                self._notes['times opened'] += 1
                self._notes_of_camera = capture.notes
                try:
                    self._stream(capture)
                finally:
                    capture.release()
                raise CameraError('the camera has stopped giving images: check its cable')
            except (CameraError, cv2.error) as error:
                self._tell(None, str(error))
            self._stop.wait(self._pause)

    def _stream(self, capture: Any) -> None:
        """Take images until there are no more."""
        due = _Due(self._rate)
        last_ns = 0
        last: NDArray | None = None
        while not self._stop.is_set() and capture.grab():
            self._trouble = ''
            stamp_ns, self._notes['kernel time stamps'] = self._clock.stamp_ns(
                capture.get(cv2.CAP_PROP_POS_MSEC), time.monotonic_ns(), self._now_ns()
            )
            if stamp_ns <= last_ns:
                self._notes['repeated images left out'] += 1
                continue
            last_ns = stamp_ns
            if not due.at(stamp_ns) and stamp_ns < self._wanted_after_ns:
                continue
            photograph = capture.retrieve()
            if photograph is None:
                continue
            if last is not None and np.array_equal(photograph.pixels, last):
                self._notes['repeated images left out'] += 1
                continue
            last = photograph.pixels
            self._tell(Frame(photograph, stamp_ns))

    def _tell(self, newest: Frame | None, trouble: str = '') -> None:
        with self._changed:
            self._newest, self._trouble = newest, trouble
            if newest is not None and newest.stamp_ns >= self._wanted_after_ns:
                self._wanted_after_ns = math.inf
            self._changed.notify_all()
