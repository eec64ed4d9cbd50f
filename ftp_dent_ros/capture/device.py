"""A camera that runs by itself: always the newest frame, never an old one again."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.capture.source import ExposureClock, Frame
from ftp_dent_ros.errors import CameraError
from ftp_dent_ros.photograph.photograph import Photograph

# Seconds between two tries to open a camera that is gone, doubled from the one to the other.
_FIRST_PAUSE, _LONGEST_PAUSE = 0.5, 8.0
# Seconds without an image after which one is told to be missing.
_PATIENCE = 3.0


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


class DeviceSource:
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
        self.finished = False
        self.missed = 0
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
        self._wanted_after_ns: int | None = None
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
        exposure_ns = round(self._clock.exposure / 2 * 1e9)
        after_ns = self._now_ns() + exposure_ns
        with self._changed:
            self._wanted_after_ns = after_ns
        frame = self._take(_PATIENCE, after_ns)
        if frame is None:
            raise CameraError(f'the camera gave no image for {_PATIENCE:g} s: check its cable')
        return frame

    def rest(self) -> None:
        """Nothing to do: a camera runs whether it is wanted or not."""

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
                self._set_trouble(str(error))
            self._stop.wait(pause)
            pause = min(2 * pause, _LONGEST_PAUSE)

    def _stream(self, capture: Any) -> bool:
        """Take images until there are no more; whether there was any."""
        due = _Due(self._rate)
        last_ns = 0
        last: NDArray | None = None
        while not self._stop.is_set() and capture.grab():
            self._set_trouble('')
            stamp_ns, self._kernel_stamps = self._clock.stamp_ns(
                capture.get(cv2.CAP_PROP_POS_MSEC), time.monotonic_ns(), self._now_ns()
            )
            if stamp_ns <= last_ns:
                self._repeated += 1
                continue
            last_ns = stamp_ns
            if not due.at(stamp_ns) and not self._is_wanted(stamp_ns):
                continue
            good, image = capture.retrieve()
            if not good:
                continue
            photograph = image if isinstance(image, Photograph) else _of_bgr(image)
            if last is not None and np.array_equal(photograph.pixels, last):
                self._repeated += 1
                continue
            last = photograph.pixels
            self._give(Frame(photograph, stamp_ns))
        return last is not None

    def _is_wanted(self, stamp_ns: int) -> bool:
        with self._changed:
            return self._wanted_after_ns is not None and stamp_ns >= self._wanted_after_ns

    def _set_trouble(self, trouble: str) -> None:
        with self._changed:
            self._trouble = trouble
            if trouble:
                self._newest = None
                self._changed.notify_all()

    def _give(self, frame: Frame) -> None:
        with self._changed:
            self._newest = frame
            if self._wanted_after_ns is not None and frame.stamp_ns >= self._wanted_after_ns:
                self._wanted_after_ns = None
            self._changed.notify_all()


def _of_bgr(image: NDArray[np.uint8]) -> Photograph:
    return Photograph(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8))
