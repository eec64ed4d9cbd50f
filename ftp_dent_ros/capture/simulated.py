"""The simulated camera: sees the simulated skin from the simulated drone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.capture.source import Frame, PacedSource
from ftp_dent_ros.errors import CameraError
from ftp_dent_ros.photograph.photograph import Photograph

# A busy machine may compute a photograph that much later than it was taken, seconds.
_PATIENCE = 6.0
# Projected images that may be photographed that late.
_MOST = 16


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
        if not self._pace.wait(timeout):
            return None
        frame = self._photograph_at(self._now_ns() - round(self._pace.late * 1e9))
        if projected is not self._prepared:
            # Tables are made for the first photograph of a pattern: what falls due meanwhile is
            # not missed, and the next one is due a period from now.
            self._prepared = projected
            self.rest()
            self._pace.wait(0.0)
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
    """

    def __init__(
        self, folder: Path, rate: float, start_ns: int, now_ns: Callable[[], int]
    ) -> None:
        super().__init__(rate)
        self._paths = sorted(folder.glob('*.npz'))
        self._period_ns, self._start_ns, self._now_ns = round(1e9 / rate), start_ns, now_ns
        self._next = 0

    def next_frame(self, timeout: float) -> Frame | None:
        """Photograph that is due next; None if none is within `timeout` seconds."""
        due = (self._now_ns() - self._start_ns) // self._period_ns
        self._pace.missed += max(due - self._next, 0)
        number = self._next = max(due, self._next)
        stamp_ns = self._start_ns + number * self._period_ns
        self.finished = number >= len(self._paths)
        early = (stamp_ns - self._now_ns()) / 1e9
        if self.finished or self._pace.pause(min(early, timeout)) or early > timeout:
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
