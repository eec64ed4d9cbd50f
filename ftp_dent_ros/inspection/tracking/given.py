"""What a list was given of one frame, to be placed once more when more is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.pose import Pose


@dataclass(frozen=True, eq=False)
class Given:
    """What was added of a frame.

    Attributes
    ----------
    frame : int
        Its number.
    dents : sequence of MeasuredDent
    pose : Pose, optional
    covariance : ndarray, shape (6, 6), optional
    repeats : sequence of tuple of MeasuredDent
        For each dent its measurements on parts of the cloud.
    base : Pose
        How the list had been moved by then.
    """

    frame: int
    dents: Sequence[MeasuredDent]
    pose: Pose | None
    covariance: NDArray[np.float64] | None
    repeats: Sequence[tuple[MeasuredDent, ...]]
    base: Pose

    def moved(self, base: Pose) -> Given:
        """The same where the list is now."""
        if base is self.base:
            return self
        move = base @ self.base.inverse()
        return replace(
            self,
            dents=[each.transformed(move) for each in self.dents],
            pose=None if self.pose is None else move @ self.pose,
            repeats=[tuple(one.transformed(move) for one in each) for each in self.repeats],
            base=base,
        )
