"""What a camera is to the node: a source of stamped photographs."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.photograph.photograph import Photograph


@dataclass(frozen=True, eq=False)
class Frame:
    """A photograph and when it was taken.

    Attributes
    ----------
    photograph : Photograph
    stamp_ns : int
        Middle of the exposure, nanoseconds of ROS time.
    """

    photograph: Photograph
    stamp_ns: int

    @property
    def image(self) -> NDArray[np.uint8]:
        """RGB of 8 bits, shape (height, width, 3), to look at."""
        return self.photograph.shown()


class Source(Protocol):
    """A camera of some kind.

    Both ways to a frame raise `CameraError` when the camera does not work (try again later), and
    `ImageError` when this one image is unusable.

    Attributes
    ----------
    finished : bool
        Whether there will never be another frame.
    missed : int
        Frames that were due and were not taken, because the one before took too long.
    runs_by_itself : bool
        Whether it takes frames, wanted or not; if not, each is made when it is asked for.
    """

    finished: bool
    runs_by_itself: bool

    @property
    def missed(self) -> int:
        """Number of frames that were due and were not taken."""

    def notes(self) -> dict[str, object]:
        """What else is worth knowing of its state, by name."""

    def next_frame(self, timeout: float) -> Frame | None:
        """Frame that is due by the source's rate; None if none is within `timeout` seconds."""

    def shoot(self) -> Frame | None:
        """Frame at once, exposed after this call; None when finished."""

    def rest(self) -> None:
        """Nobody wants frames at present: what falls due meanwhile is not missed."""

    def close(self) -> None:
        """Let go of the camera; the source cannot be used after this."""


class Pace:
    """Regular deadlines; one that passed while the frame before was made is left out.

    Parameters
    ----------
    rate : float
        Deadlines a second; 0 for none.
    now : callable
        Monotonic time in seconds.
    patience : float
        Seconds by which a deadline may have passed and is not left out all the same.
    """

    def __init__(
        self, rate: float, now: Callable[[], float] = time.monotonic, patience: float = 0.0
    ) -> None:
        self._period = 1 / rate if rate > 0 else float('inf')
        self._now = now
        self._patience = patience
        self._stop = threading.Event()
        self.missed = 0
        self.restart()

    def wait(self, timeout: float) -> bool:
        """Wait for the next deadline, but `timeout` seconds at most; whether it was reached."""
        early = self._due - self._now()
        if early > 0 and (self._stop.wait(min(early, timeout)) or early > timeout):
            return False
        late = max(0.0, self._now() - self._due - self._patience)
        missed = int(late / self._period)
        self.missed += missed
        self._due += (1 + missed) * self._period
        return True

    def pause(self, seconds: float) -> bool:
        """Wait so long; whether all waiting was ended."""
        return self._stop.wait(max(seconds, 0.0))

    @property
    def late(self) -> float:
        """Seconds since the deadline that was reached last."""
        return self._now() - (self._due - self._period)

    def restart(self) -> None:
        """Let the next deadline be now."""
        self._due = self._now() if self._period < float('inf') else float('inf')

    def stop(self) -> None:
        """End all waiting."""
        self._stop.set()


class PacedSource:
    """Common part of the sources that make their frames when they are asked to."""

    runs_by_itself = False

    def __init__(self, rate: float, patience: float = 0.0) -> None:
        self.finished = False
        self._pace = Pace(rate, patience=patience)

    @property
    def missed(self) -> int:
        """Frames that were due while the one before was still being made."""
        return self._pace.missed

    def notes(self) -> dict[str, object]:
        """How many frames were due and not taken."""
        return {'missed': self.missed}

    def next_frame(self, timeout: float) -> Frame | None:
        """Frame that is due by the rate; None if none is within `timeout` seconds."""
        return self.shoot() if self._pace.wait(timeout) else None

    def shoot(self) -> Frame | None:
        """Frame at once; None when finished."""
        raise NotImplementedError

    def rest(self) -> None:
        """Nobody wants frames at present."""
        self._pace.restart()

    def close(self) -> None:
        """End all waiting."""
        self._pace.stop()


@dataclass(frozen=True)
class ExposureClock:
    """Turns the time of a buffer into the middle of its exposure.

    Attributes
    ----------
    exposure : float
        Seconds; 0 if unknown.
    at_start : bool
        Whether the driver stamps the start of the exposure (``V4L2_BUF_FLAG_TSTAMP_SRC_SOE``),
        not the end of the frame, which is V4L2's default.
    offset : float
        Seconds added to every stamp, for what is known of this camera's delay.
    """

    exposure: float = 0.0
    at_start: bool = False
    offset: float = 0.0

    def stamp_ns(self, buffer_ms: float, monotonic_ns: int, ros_ns: int) -> tuple[int, bool]:
        """Middle of the exposure, and whether it comes from the kernel.

        Parameters
        ----------
        buffer_ms : float
            Time of the buffer on the monotonic clock, milliseconds (``CAP_PROP_POS_MSEC``).
        monotonic_ns, ros_ns : int
            Monotonic time and ROS time of one moment just after the buffer arrived.

        Returns
        -------
        int
            Nanoseconds of ROS time. Where the buffer's time is implausible, the time of arrival
            less half the exposure: readout and transfer are then in the stamp.
        bool
        """
        age = monotonic_ns - round(buffer_ms * 1e6)
        # A buffer older than this was not just filled; one from the future, beyond what a driver's
        # clock recovery may err by, is another clock's (or the position in a video file).
        from_kernel = buffer_ms > 0 and (-5_000_000) <= age <= 1_000_000_000
        half = self.exposure / 2
        to_middle = half if from_kernel and self.at_start else -half
        taken = ros_ns - (age if from_kernel else 0)
        return taken + round((to_middle + self.offset) * 1e9), from_kernel


def stamps_exposure_start(device: str) -> bool:
    """Whether the driver of a device file stamps the start of the exposure, as uvcvideo does."""
    name = Path(device).resolve().name
    driver = Path('/sys/class/video4linux') / name / 'device' / 'driver'
    return driver.resolve().name == 'uvcvideo'
