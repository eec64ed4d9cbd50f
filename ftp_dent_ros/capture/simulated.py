"""The simulated camera: sees the simulated skin from the simulated drone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.capture.source import Frame, PacedSource
from ftp_dent_ros.errors import CameraError


class SimulatedSource(PacedSource):
    """Photographs that are computed when they are due.

    Parameters
    ----------
    photograph : callable
        Gives the camera's RGB image of what the projector shows (RGB) at a time (nanoseconds).
    rate : float
        Images a second; 0 for none unless asked for.
    now_ns : callable
        ROS time, nanoseconds: the middle of the exposure is the moment at which a frame is due.
    """

    def __init__(
        self,
        photograph: Callable[[NDArray[np.uint8], int], NDArray[np.uint8]],
        rate: float,
        now_ns: Callable[[], int],
    ) -> None:
        super().__init__(rate)
        self._photograph = photograph
        self._now_ns = now_ns
        self._projected: NDArray[np.uint8] | None = None

    def project(self, image: NDArray[np.uint8]) -> None:
        """Let the projector show RGB pixels from now on."""
        self._projected = image

    def shoot(self) -> Frame:
        """Photograph of this moment.

        Raises
        ------
        CameraError
            Nothing is projected yet.
        ImageError
            What is projected has not the projector's size.
        """
        projected = self._projected
        if projected is None:
            raise CameraError('nothing is projected yet: start pattern_publisher')
        stamp_ns = self._now_ns()
        return Frame(self._photograph(projected, stamp_ns), stamp_ns)
