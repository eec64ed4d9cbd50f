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
from ftp_dent_ros.capture.source import CameraSettings, ExposureClock, Frame, Source
from ftp_dent_ros.errors import CameraError, ConfigurationError
from ftp_dent_ros.photograph.photograph import Photograph

# OpenCV's V4L2 backend delivers these with red and blue swapped in some versions: the red
# stripe would be blue.
_SWAPPED = ('NV12', 'NV21')

# Seconds between two tries to open a camera that is gone, doubled from the one to the other.
_FIRST_PAUSE, _LONGEST_PAUSE = 0.5, 8.0
# Seconds without an image after which one is told to be missing.
_PATIENCE = 3.0


@dataclass(frozen=True, kw_only=True)
class DeviceSettings(CameraSettings):
    """What is asked of a V4L2 camera.

    Attributes
    ----------
    path : str
        Device file; a link under ``/dev/v4l/by-id`` names the same camera on every port.
    fourcc : str
        Pixel format of V4L2, of four characters ('MJPG', 'YUYV', 'GREY', 'Y12 ', 'RG12'); empty
        leaves it as it is.

    Raises
    ------
    ConfigurationError
        A value is impossible.
    """

    path: str
    fourcc: str = ''

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
    controls: list[tuple[int, float, str]] = []
    if settings.exposure > 0:
        # A value of V4L2_CID_EXPOSURE_AUTO, and the unit of V4L2_CID_EXPOSURE_ABSOLUTE.
        units = max(1, round(settings.exposure / 100e-6))
        controls.append((cv2.CAP_PROP_AUTO_EXPOSURE, 1, 'a fixed exposure'))
        controls.append((cv2.CAP_PROP_EXPOSURE, units, f'an exposure of {settings.exposure:g} s'))
    if settings.gain >= 0:
        controls.append((cv2.CAP_PROP_GAIN, settings.gain, f'a gain of {settings.gain:g}'))
    for what, value, name in controls:
        # A driver may round to its own steps.
        if not capture.set(what, value) or abs(capture.get(what) - value) > max(0.5, 0.05 * value):
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
        self._period_ns = round(1e9 / rate) if rate > 0 else None
        self._next_ns: int | None = None
        self._last_ns: int | None = None

    def at(self, stamp_ns: int) -> bool:
        # Half the camera's interval of tolerance: one just slower than the rate loses no frame.
        tolerance_ns = (stamp_ns - (self._last_ns or stamp_ns)) // 2
        self._last_ns = stamp_ns
        if self._period_ns is None:
            return False
        due_ns = self._next_ns if self._next_ns is not None else stamp_ns
        if stamp_ns < due_ns - tolerance_ns:
            return False
        self._next_ns = max(due_ns + self._period_ns, stamp_ns + self._period_ns // 2)
        return True


class DeviceSource(Source):
    """Frames of a camera that is opened again, with growing pauses, whenever it fails.

    A thread takes every image from the driver, so that none grows old in its queue, and decodes
    those that are due. A frame whose time is not later than that of the one before, or whose
    pixels are the same (OpenCV repeats the last image when a JPEG is damaged), is left out.

    Parameters
    ----------
    open_capture : callable
        Opens the camera, or raises `CameraError`. What it retrieves is BGR as OpenCV's, or a
        `Photograph`.
    rate : float
        Frames a second, if the camera gives more; 0 for none unless asked for.
    clock : ExposureClock
    now_ns : callable
        ROS time, nanoseconds.
    first_pause : float
        Seconds before the first attempt to open the camera again; doubled with each, up to 8.
    """

    runs_by_itself = True

    def __init__(
        self,
        open_capture: Callable[[], Any],
        rate: float,
        clock: ExposureClock,
        now_ns: Callable[[], int],
        first_pause: float = _FIRST_PAUSE,
    ) -> None:
        self._repeated = 0
        self._opened = 0
        self._kernel_stamps = False
        self._open_capture = open_capture
        self._rate = rate
        self._clock = clock
        self._now_ns = now_ns
        self._first_pause = first_pause
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._wanted_after_ns = math.inf
        self._trouble = ''
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='camera', daemon=True)
        self._thread.start()

    def notes(self) -> dict[str, object]:
        """How the camera does."""
        return {
            'times opened': self._opened,
            'repeated images left out': self._repeated,
            'kernel time stamps': self._kernel_stamps,
        }

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
        pause = self._first_pause
        while not self._stop.is_set():
            try:
                capture = self._open_capture()
                self._opened += 1
                try:
                    if self._stream(capture):
                        pause = self._first_pause
                finally:
                    capture.release()
                raise CameraError('the camera has stopped giving images: check its cable')
            except (CameraError, cv2.error) as error:
                self._tell(None, str(error))
            self._stop.wait(pause)
            pause = min(2 * pause, _LONGEST_PAUSE)

    def _stream(self, capture: Any) -> bool:
        """Take images until there are no more; whether there was any."""
        due = _Due(self._rate)
        last_ns = 0
        last: NDArray | None = None
        while not self._stop.is_set() and capture.grab():
            self._trouble = ''
            stamp_ns, self._kernel_stamps = self._clock.stamp_ns(
                capture.get(cv2.CAP_PROP_POS_MSEC), time.monotonic_ns(), self._now_ns()
            )
            if stamp_ns <= last_ns:
                self._repeated += 1
                continue
            last_ns = stamp_ns
            if not due.at(stamp_ns) and stamp_ns < self._wanted_after_ns:
                continue
            good, image = capture.retrieve()
            if not good:
                continue
            if not isinstance(image, Photograph):
                image = Photograph(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8))
            if last is not None and np.array_equal(image.pixels, last):
                self._repeated += 1
                continue
            last = image.pixels
            self._tell(Frame(image, stamp_ns))
        return last is not None

    def _tell(self, newest: Frame | None, trouble: str = '') -> None:
        with self._changed:
            self._newest, self._trouble = newest, trouble
            if newest is not None and newest.stamp_ns >= self._wanted_after_ns:
                self._wanted_after_ns = math.inf
            self._changed.notify_all()
