"""The pose of a camera by its cloud before and after it was put into the map."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose


def pose_between(seen: Cloud, placed: Cloud) -> Pose | None:
    """Pose that moved one cloud onto the other, or None if none did.

    Source: W. Kabsch, Acta Cryst. A32, 922 (1976).
    """
    if seen.points.shape != placed.points.shape:
        return None
    both = seen.valid & placed.valid
    if both.sum() < 3:
        return None
    a, b = seen.points[both].astype(float), placed.points[both].astype(float)
    middle_a, middle_b = a.mean(axis=0), b.mean(axis=0)
    u, _, vt = np.linalg.svd((b - middle_b).T @ (a - middle_a))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    pose = Pose(Rotation.from_matrix(turn), middle_b - turn @ middle_a)
    # Single precision at kilometres from the map's origin is not better.
    tolerance = 1e-5 + 1e-6 * float(np.abs(middle_b).max())
    return pose if np.abs(pose.apply(a) - b).mean() < tolerance else None
