"""How good a rig is, told by poses that it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.adjustment.bundle import Estimate, adjust, rms
from ftp_dent_ros.calibration.adjustment.model import Model
from ftp_dent_ros.calibration.adjustment.selection import folds, held_out
from ftp_dent_ros.calibration.adjustment.uncertainty import depths
from ftp_dent_ros.calibration.observing.observation import Observation


@dataclass(frozen=True, eq=False)
class HeldOut:
    """What poses say of a rig that was fitted to the others, half by half.

    Attributes
    ----------
    rms : tuple of 3 floats
        Camera, projector and both, pixels.
    stereo_rms : float
        Of the projector, with the board's place told by the camera alone; pixels.
    depth_errors : ndarray, shape (m,)
        Of every corner: its triangulated depth less that of the board's plane; metres.
    depths : ndarray, shape (m,)
        Of the corners, metres.
    """

    rms: tuple[float, float, float]
    stereo_rms: float
    depth_errors: NDArray[np.float64]
    depths: NDArray[np.float64]


def hold_out(
    used: list[Observation], points: NDArray, estimate: Estimate, model: Model
) -> HeldOut | None:
    """Fit to each half of the poses and look at the other; None if there are too few."""
    parts = folds(len(used), 2)
    if not parts:
        return None
    residuals, stereo, errors, places = [], [], [], []
    for out in parts:
        found, fitted = held_out(used, points, estimate, model, out)
        residuals += found
        seen = camera_alone(used, points, replace(estimate, rig=fitted.rig), out)
        for index, pose in zip(out, seen.poses, strict=True):
            corners = Rotation.from_rotvec(pose[:3]).apply(estimate.shape) + pose[3:]
            predicted = fitted.rig.projector.project(fitted.rig.to_projector(corners))
            stereo.append(used[index].projector - predicted)
            known = np.isfinite(used[index].projector[:, 0] + used[index].camera[:, 0])
            measured = depths(
                fitted.rig, used[index].camera[known], used[index].projector[known, 0]
            )
            errors.append(measured - corners[known, 2])
            places.append(corners[known, 2])
    off = np.concatenate(stereo)
    square = np.square(off[np.isfinite(off).all(axis=1)]).sum(axis=1)
    return HeldOut(
        rms(residuals),
        float(np.sqrt(square.mean())),
        np.concatenate(errors),
        np.concatenate(places),
    )


def camera_alone(
    used: list[Observation], points: NDArray, estimate: Estimate, which: NDArray
) -> Estimate:
    """Poses as the camera alone tells them, with an estimate's rig."""
    return adjust(
        [replace(used[i], projector=np.full_like(used[i].projector, np.nan)) for i in which],
        points,
        estimate.rig,
        estimate.poses[which],
        Model(),
        free='none',
        shape=estimate.shape,
        deviations=estimate.deviations,
    )
