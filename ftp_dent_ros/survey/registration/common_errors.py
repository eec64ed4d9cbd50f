"""Errors that all clouds of a rig have in common, and what they do to the poses of pairs.

A rig is known as well as it was calibrated, and what is left is the same in each cloud: all are
bent alike, and a little too large or too small. A pair cannot show it (both clouds are wrong in
the same way, and fit), but each pair of a pass then errs to the same side, and a long pass bends
and stretches. So it is one unknown of the whole survey, of which its prior is known alone: six
numbers, of which three bend a cloud and three stretch it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose

Array = NDArray[np.float64]

# Standard deviations of what calibrations leave (benchmarks/calibration.py): focal lengths and
# baselines are off by 0.003 %, which stretches; 0.002 px that the camera or the projector is off
# at its rim are 3 micrometres of height 0.25 m from the middle, which bends, in 1/m.
_BEND, _STRETCH = 5e-5, 3e-5
#: Covariance of the six: of x^2, 2 x y and y^2 in the height, and of the stretch along x, in
#: shear, and along y; x and y are a patch's.
COMMON = np.diag(np.square([_BEND] * 3 + [_STRETCH] * 3))
_FORMS = np.array([[[1.0, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]]])


def in_common(centre: Array, pose: Pose) -> Array:
    """How the pose of one patch on another errs with what both have in common.

    Parameters
    ----------
    centre : ndarray, shape (3,)
        Of what both saw, metres, in the first patch's frame.
    pose : Pose
        Of the second patch in the first.

    Returns
    -------
    ndarray, shape (6, 6)
        Change of the shift of the centre and the turn about it, along the first patch's axes.
    """
    here, there = centre[:2], pose.inverse().apply(centre)[:2]
    turn = pose.rotation.as_matrix()[:2, :2]
    result = np.zeros((6, 6))
    for index, form in enumerate(_FORMS):
        # Heights of the first less those of the second: their value and slope at the centre.
        result[2, index] = here @ form @ here - there @ form @ there
        slope = 2 * (form @ here - turn @ form @ there)
        result[3, index], result[4, index] = slope[1], -slope[0]
        result[:2, 3 + index] = form @ here - turn @ form @ there
    return result
