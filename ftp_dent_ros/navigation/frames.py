"""MAVLink's frames and ROS's: every conversion, named once.

=============  ==========================  ============================
               MAVLink (aeronautical)      ROS (REP 103, REP 105)
=============  ==========================  ============================
world          NED: north, east, down      ENU: east, north, up (`map`)
body           FRD: forward, right, down   FLU: forward, left, up (`base_link`)
attitude       q = w, x, y, z; FRD -> NED  q = x, y, z, w; FLU -> ENU
yaw            0 north, clockwise          0 east, counter-clockwise
=============  ==========================  ============================

World and body frames each differ by half a turn, so that each conversion of vectors is its own
inverse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def enu_from_ned(vector: ArrayLike) -> NDArray[np.float64]:
    """World vector(s) of shape (..., 3): (north, east, down) -> (east, north, up)."""
    north, east, down = np.moveaxis(np.asarray(vector, float), -1, 0)
    return np.stack([east, north, -down], axis=-1)


def flu_from_frd(vector: ArrayLike) -> NDArray[np.float64]:
    """Body vector(s) of shape (..., 3): (forward, right, down) -> (forward, left, up)."""
    return np.asarray(vector, float) * [1.0, -1.0, -1.0]


def enu_attitude(quaternion: ArrayLike) -> NDArray[np.float64]:
    """Attitude quaternion of MAVLink's -> of ROS's.

    FLU -> ENU is (NED -> ENU) (FRD -> NED) (FLU -> FRD): multiplied from the left by half a turn
    about the horizontal diagonal (i + j) / sqrt(2), which swaps north with east and up with down,
    and from the right by half a turn about the nose, i. That is linear in the quaternion, and a
    stream whose sign is continuous stays continuous.

    Parameters
    ----------
    quaternion : array_like, shape (..., 4)
        w, x, y, z of the rotation FRD -> NED (``q1`` to ``q4`` of ATTITUDE_QUATERNION).

    Returns
    -------
    ndarray, shape (..., 4)
        x, y, z, w of the rotation FLU -> ENU (as in geometry_msgs).
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    return np.sqrt(0.5) * np.stack([x + y, x - y, w - z, w + z], axis=-1)


def ned_attitude(quaternion: ArrayLike) -> NDArray[np.float64]:
    """Attitude quaternion of ROS's -> of MAVLink's; the inverse of `enu_attitude`."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    return np.sqrt(0.5) * np.stack([w + z, x + y, x - y, w - z], axis=-1)
