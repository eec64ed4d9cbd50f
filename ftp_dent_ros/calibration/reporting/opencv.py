"""OpenCV's calibration of the same observations, for the page: nothing else uses it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ftp_dent_ros.calibration.adjustment.solving import Solution
from ftp_dent_ros.rig.rig import Lens, Rig


@dataclass(frozen=True, eq=False)
class OpenCvResult:
    """A rig of calibrateCamera, twice, and stereoCalibrate.

    Attributes
    ----------
    rig : Rig
    rms : tuple of 3 floats
        Of camera and projector each by itself, and of both with all refined; pixels.
    """

    rig: Rig
    rms: tuple[float, float, float]


def calibrate_with_opencv(solution: Solution) -> OpenCvResult | None:
    """What OpenCV makes of the corners that camera and projector both have; None if it fails."""
    points, seen, lit = [], [], []
    for observation in solution.observations:
        both = np.isfinite(observation.camera).all(axis=1)
        both &= np.isfinite(observation.projector).all(axis=1)
        if both.sum() >= 8:
            points.append(solution.board.points[both].astype(np.float32))
            seen.append(observation.camera[both].astype(np.float32))
            lit.append(observation.projector[both].astype(np.float32))
    camera, projector = solution.rig.camera, solution.rig.projector
    size, shown = (camera.width, camera.height), (projector.width, projector.height)
    try:
        nothing = np.zeros(5)
        first = cv2.calibrateCamera(points, seen, size, np.eye(3), nothing)
        second = cv2.calibrateCamera(points, lit, shown, np.eye(3), nothing.copy())
        both_rms, *matrices, turn, shift, _, _ = cv2.stereoCalibrate(
            points, seen, lit, first[1], first[2], second[1], second[2], size, flags=0
        )
    except cv2.error:
        return None
    lenses = [
        Lens(like.width, like.height, np.asarray(matrix), np.ravel(distortion)[:5].astype(float))
        for like, matrix, distortion in (
            (camera, matrices[0], matrices[1]),
            (projector, matrices[2], matrices[3]),
        )
    ]
    rig = Rig(lenses[0], lenses[1], np.asarray(turn, float), np.ravel(shift).astype(float))
    return OpenCvResult(rig, (first[0], second[0], both_rms))
