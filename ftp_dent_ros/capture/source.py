"""What a camera is to the node: a source of stamped photographs; files, and the simulated ones."""

from __future__ import annotations

import glob
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CameraError, ConfigurationError, ImageError
from ftp_dent_ros.files import by_number
from ftp_dent_ros.photograph.file import is_photograph, photograph_of_bgr, read_photograph
from ftp_dent_ros.photograph.photograph import Encoding, Photograph

# A busy machine may compute a photograph that much later than it was taken, seconds.
_PATIENCE = 6.0
# Projected images that may be photographed that late.
_MOST = 16


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


class Source:
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

    finished = False
    missed = 0
    runs_by_itself = False

    def notes(self) -> dict[str, object]:
        """What else is worth knowing of its state, by name."""
        return {'missed': self.missed}

    def next_frame(self, timeout: float) -> Frame | None:
        """Frame that is due by the source's rate; None if none is within `timeout` seconds."""
        raise NotImplementedError

    def shoot(self) -> Frame | None:
        """Frame at once, exposed after this call; None when finished."""
        raise NotImplementedError

    def rest(self) -> None:
        """Nobody wants frames at present: what falls due meanwhile is not missed."""

    def close(self) -> None:
        """Let go of the camera; the source cannot be used after this."""


class PacedSource(Source):
    """Common part of the sources that make their frames when they are asked to.

    Parameters
    ----------
    rate : float
        Frames a second; 0 for none unless asked for.
    patience : float
        Seconds by which a frame may be made late; one that was due longer ago is left out.
    """

    def __init__(self, rate: float, patience: float = 0.0) -> None:
        self._period = 1 / rate if rate > 0 else float('inf')
        self._patience = patience
        self._closed = threading.Event()
        self.rest()

    def next_frame(self, timeout: float) -> Frame | None:
        """Frame that is due by the rate; None if none is within `timeout` seconds."""
        return self.shoot() if self._falls_due(timeout) else None

    def rest(self) -> None:
        """Let the next frame be due now."""
        self._due = time.monotonic() if self._period < float('inf') else float('inf')

    def close(self) -> None:
        """End all waiting."""
        self._closed.set()

    def _falls_due(self, timeout: float) -> bool:
        """Wait for the time at which a frame is due, but `timeout` seconds at most."""
        early = self._due - time.monotonic()
        if not self._waited(early, timeout):
            return False
        missed = int(max(0.0, -early - self._patience) / self._period)
        self.missed += missed
        self._due += (1 + missed) * self._period
        return True

    def _waited(self, early: float, timeout: float) -> bool:
        """Whether a moment so many seconds ahead has come, after `timeout` seconds at most."""
        return not self._closed.wait(min(max(early, 0.0), timeout)) and early <= timeout


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
    driver = Path('/sys/class/video4linux', Path(device).resolve().name, 'device', 'driver')
    return driver.resolve().name == 'uvcvideo'


class SimulatedSource(PacedSource):
    """Photographs of the moments at which they are due, computed then or a little later.

    Parameters
    ----------
    photograph : callable
        Gives the camera's photograph of what the projector shows (RGB) at a time (nanoseconds).
    rate : float
        Images a second; 0 for none unless asked for.
    now_ns : callable
        ROS time, nanoseconds: the middle of the exposure is the moment at which a frame is due.
    """

    def __init__(
        self,
        photograph: Callable[[NDArray[np.uint8], int], Photograph],
        rate: float,
        now_ns: Callable[[], int],
    ) -> None:
        super().__init__(rate, _PATIENCE)
        self._photograph = photograph
        self._now_ns = now_ns
        self._projected: tuple[tuple[int, NDArray[np.uint8]], ...] = ()
        self._prepared: NDArray[np.uint8] | None = None

    def project(self, image: NDArray[np.uint8], from_ns: int) -> None:
        """Let the projector show RGB pixels from a time on, nanoseconds."""
        shown = sorted((*self._projected, (from_ns, image)), key=lambda entry: entry[0])
        self._projected = tuple(shown[-_MOST:])

    def next_frame(self, timeout: float) -> Frame | None:
        """Photograph that is due by the rate; None if none is within `timeout` seconds."""
        projected = self._shown(self._now_ns())
        if not self._falls_due(timeout):
            return None
        late = time.monotonic() - (self._due - self._period)
        frame = self._photograph_at(self._now_ns() - round(late * 1e9))
        if projected is not self._prepared:
            # Tables are made for the first photograph of a pattern: what falls due meanwhile is
            # not missed, and the next one is due a period from now.
            self._prepared = projected
            self.rest()
            self._due += self._period
        return frame

    def shoot(self) -> Frame:
        """Photograph of this moment.

        Raises
        ------
        CameraError
            Nothing is projected yet.
        ImageError
            What is projected has not the projector's size.
        """
        return self._photograph_at(self._now_ns())

    def _photograph_at(self, stamp_ns: int) -> Frame:
        return Frame(self._photograph(self._shown(stamp_ns), stamp_ns), stamp_ns)

    def _shown(self, stamp_ns: int) -> NDArray[np.uint8]:
        projected = [image for from_ns, image in self._projected if from_ns <= stamp_ns]
        if not projected:
            raise CameraError('nothing is projected yet: start pattern_publisher')
        return projected[-1]


class RenderedSource(PacedSource):
    """Photographs of the simulation that were rendered ahead, each taken at its own time.

    Parameters
    ----------
    folder : Path
        Holds ``0000.npz`` and so on, as `write_rendered` writes them.
    rate : float
        Of the photographs, the first of which is of the flight's start.
    start_ns : int
        ROS time at which the flight starts, nanoseconds.
    now_ns : callable
        ROS time, nanoseconds.

    Raises
    ------
    ConfigurationError
        The folder has no photographs, or the rate is not above 0.
    """

    def __init__(
        self, folder: Path, rate: float, start_ns: int, now_ns: Callable[[], int]
    ) -> None:
        self._paths = sorted(folder.glob('*.npz'))
        if not self._paths or rate <= 0:
            raise ConfigurationError(
                f'{folder}: photographs that were rendered ahead are files NUMBER.npz there, and '
                f'their rate is above 0, not {rate:g}: correct simulation.ahead or rate'
            )
        self._period_ns, self._start_ns, self._now_ns = round(1e9 / rate), start_ns, now_ns
        self._next = 0
        super().__init__(rate)

    def next_frame(self, timeout: float) -> Frame | None:
        """Photograph that is due next; None if none is within `timeout` seconds."""
        due = (self._now_ns() - self._start_ns) // self._period_ns
        self.missed += max(due - self._next, 0)
        number = self._next = max(due, self._next)
        stamp_ns = self._start_ns + number * self._period_ns
        self.finished = number >= len(self._paths)
        if self.finished or not self._waited((stamp_ns - self._now_ns()) / 1e9, timeout):
            return None
        self._next += 1
        with np.load(self._paths[number]) as kept:
            photograph = Photograph(kept['pixels'], int(kept['white']), str(kept['mosaic']))
        return Frame(photograph, stamp_ns)

    def rest(self) -> None:
        """What falls due meanwhile is not missed."""
        self._next = max(0, -((self._start_ns - self._now_ns()) // self._period_ns))

    def shoot(self) -> Frame | None:
        """The next photograph that is due."""
        return self.next_frame(2 * self._period_ns / 1e9)


def write_rendered(folder: Path, number: int, photograph: Photograph) -> None:
    """Write the photograph of a number for `RenderedSource`."""
    np.savez(
        folder / f'{number:04}.npz',
        pixels=photograph.pixels,
        white=photograph.white,
        mosaic=photograph.mosaic,
    )


class FileSource(PacedSource):
    """Images of files, one after the other, stamped with the time at which they are read.

    Parameters
    ----------
    path : str
        A folder (its images in the order of their names, numbers by their value), a pattern of
        names with ``*``, ``?`` or ``[]``, an image, or a video.
    rate : float
        Images a second; 0 for none unless asked for.
    loop : bool
        Whether the first image follows the last.
    size : (int, int), optional
        Width and height that every image must have.
    now_ns : callable
        Time of a frame, nanoseconds of ROS time.
    encoding : str
        Of images, as `photograph.file.read_photograph` takes it.

    Raises
    ------
    ConfigurationError
        There is no such file, no image among them, or no such encoding.
    ImageError
        From `next_frame` and `shoot`: a file is no image or has the wrong size; the one after it
        comes next.
    """

    def __init__(
        self,
        path: str,
        rate: float,
        loop: bool,
        size: tuple[int, int] | None,
        now_ns: Callable[[], int],
        encoding: str = '',
    ) -> None:
        super().__init__(rate)
        if encoding:
            Encoding.named(encoding)
        self._encoding = encoding
        self._paths = find_images(path)
        self._loop = loop
        self._size = size
        self._now_ns = now_ns
        self._images = self._read()

    def shoot(self) -> Frame | None:
        """Next image at once; None after the last."""
        following = next(self._images, None)
        if following is None:
            self.finished = True
            return None
        path, image = following
        photograph = (
            read_photograph(path, self._encoding)
            if image is None
            else photograph_of_bgr(image, self._encoding, str(path))
        )
        width, height = photograph.width, photograph.height
        if self._size and (width, height) != self._size:
            raise ImageError(
                f'{path}: has {width}x{height} pixels, the camera of the rig '
                f'{self._size[0]}x{self._size[1]}: use the images of this rig'
            )
        return Frame(photograph, self._now_ns())

    def _read(self) -> Iterator[tuple[Path, NDArray | None]]:
        """Paths and images of videos, BGR; None where a photograph is still to be read."""
        for path in cycle(self._paths) if self._loop else self._paths:
            if is_photograph(path):
                yield path, None
            else:
                yield from _video(path)


def find_images(path: str) -> list[Path]:
    """Files that `path` names: see `FileSource`.

    Raises
    ------
    ConfigurationError
        There is none.
    """
    if not path:
        raise ConfigurationError(
            'no image files are named: give a folder, a pattern of names, or a video'
        )
    given = Path(path).expanduser()
    if given.is_dir():
        found = [item for item in given.iterdir() if is_photograph(item)]
    elif given.is_file():
        found = [given]
    else:
        found = [Path(item) for item in glob.glob(str(given), recursive=True)]
        found = [item for item in found if item.is_file()]
    if not found:
        raise ConfigurationError(
            f'{path}: no photograph there (PNG, TIFF or JPEG) and no video: check the path'
        )
    return sorted(found, key=by_number)


def _video(path: Path) -> Iterator[tuple[Path, NDArray | None]]:
    capture = cv2.VideoCapture(str(path))
    try:
        good, image = capture.read()
        if not good:
            yield path, None
        while good:
            yield path, image
            good, image = capture.read()
    finally:
        capture.release()
