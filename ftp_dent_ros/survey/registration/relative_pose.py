"""Where one cloud's camera was, seen from another's, and how well that is known."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.registration.twists import twists


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Pose of one camera in another's frame, by what both saw.

    Attributes
    ----------
    pose : Pose
        Of the second camera in the first one's frame.
    centre : ndarray, shape (3,)
        About which `information` turns: the middle of what both saw, first camera's frame, metres.
    information : ndarray, shape (6, 6)
        Inverse of the covariance of the twist about `centre`, of shift (metres) and turn
        (radians), along the first camera's axes; zero in directions that the skin does not tell.
    told : int
        Directions that it does tell, up to 6.
    overlap : float
        Share of the second cloud that lies on the first.
    misfit : float
        Of the heights, root mean square along the normal, metres.
    remark : str
        What could not be used, and why; empty if all could.
    common : ndarray, shape (6, 6)
        How the twist changes with the errors that all clouds of the rig have in common, as
        `common_errors` has them.
    """

    pose: Pose
    centre: NDArray[np.float64]
    information: NDArray[np.float64]
    told: int
    overlap: float
    misfit: float
    remark: str = ''
    common: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 6)))

    def error(self, pose: Pose) -> NDArray[np.float64]:
        """Twist about the centre, shape (6,), that takes this pose to another."""
        off = pose @ self.pose.inverse()
        return twists(off.rotation.as_matrix(), off.apply(self.centre) - self.centre)


class UnlikePairError(Exception):
    """Two clouds that do not lie on each other; the message says in what."""
