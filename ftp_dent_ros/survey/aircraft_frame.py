"""The aircraft's own coordinates, from points of the map whose coordinates on it are known.

Station (fore and aft), buttock line (sideways) and water line (height) of three points or more
give the rigid motion from the map to the aircraft by least squares, weighted by both sides'
uncertainties, and with it the covariance of every place (Gauss and Newton's steps; the start is
that of W. Kabsch, Acta Cryst. A32, 922, 1976).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.inspection.tracking.moves import about
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.result import SurveyedDent

Array = NDArray[np.float64]

# Points that tell a frame, and rounds of its adjustment.
_NEEDED = 3
_ROUNDS = 4
# A turn that the points leave open by more than this standard deviation, radians, is no frame:
# places beside the points are then off by a twentieth of their distance, and no longer linearly.
_OPEN = 0.05
# Chance that right points are refused as contradicting each other.
_REFUSED = 1e-3


@dataclass(frozen=True, eq=False)
class ReferencePoint:
    """A point known on the aircraft and found in the map.

    Attributes
    ----------
    name : str
    in_map : ndarray, shape (3,)
        Metres.
    map_covariance : ndarray, shape (3, 3)
        Of that place among the others of the map, square metres.
    on_aircraft : ndarray, shape (3,)
        Station, buttock line, water line; metres.
    uncertainty : float
        Standard uncertainty of each of these, metres.
    """

    name: str
    in_map: Array
    map_covariance: Array
    on_aircraft: Array
    uncertainty: float


@dataclass(frozen=True, eq=False)
class AircraftFrame:
    """The map in the aircraft's frame.

    Attributes
    ----------
    pose : Pose
        Of the map in the aircraft's frame.
    middle : ndarray, shape (3,)
        Of the points on the aircraft, about which `covariance` turns, metres.
    covariance : ndarray, shape (6, 6)
        Of the pose: shift of the middle, and turn about it, in the aircraft's frame.
    residuals : ndarray, shape (n, 3)
        Of the points, on the aircraft, metres.
    points : tuple of ReferencePoint
    """

    pose: Pose
    middle: Array
    covariance: Array
    residuals: Array
    points: tuple[ReferencePoint, ...]

    def place(self, position: Array, covariance: Array | None = None) -> tuple[Array, Array]:
        """A place of the map on the aircraft, and its covariance.

        Parameters
        ----------
        position : ndarray, shape (3,)
        covariance : ndarray, shape (3, 3), optional
            Of the place among the others of the map, square metres.
        """
        there = self.pose.apply(np.asarray(position, float))
        jacobian = about(there - self.middle)
        spread = jacobian @ self.covariance @ jacobian.T
        if covariance is not None:
            turn = self.pose.rotation.as_matrix()
            spread = spread + turn @ covariance @ turn.T
        return there, spread

    def dent(self, each: SurveyedDent, covariance: Array | None = None) -> SurveyedDent:
        """A dent in the aircraft's frame; `covariance` is its place's among the others'."""
        _, spread = self.place(each.dent.position, covariance)
        return replace(each, dent=each.dent.transformed(self.pose), position_covariance=spread)


def aircraft_frame(points: Sequence[ReferencePoint]) -> AircraftFrame:
    """Fit the frame.

    Raises
    ------
    ConfigurationError
        There are fewer than three points, they lie on a line, or they contradict each other; the
        message names the one that does, where four or more tell.
    """
    if len(points) < _NEEDED:
        raise ConfigurationError(
            f'{len(points)} reference points do not give a frame: name {_NEEDED} or more'
        )
    frame, misfit = _fitted(points)
    turns = np.sqrt(np.linalg.eigvalsh(frame.covariance[3:, 3:]))
    if not turns[-1] < _OPEN:
        raise ConfigurationError(
            'the reference points lie on a line, or nearly, or too close together: the frame can '
            f'still turn by {math.degrees(turns[-1]):.1f} degrees (standard deviation): name '
            'another point, far off that line'
        )
    freedom = 3 * len(points) - 6
    if misfit > chi2.isf(_REFUSED, freedom):
        raise ConfigurationError(_contradiction(points, frame))
    return frame


def _contradiction(points: Sequence[ReferencePoint], frame: AircraftFrame) -> str:
    worst = float(np.linalg.norm(frame.residuals, axis=1).max()) * 1e3
    said = (
        f'the reference points contradict each other by up to {worst:.1f} mm, more than their '
        'uncertainties allow'
    )
    right = []
    for index, point in enumerate(points):
        others = [*points[:index], *points[index + 1 :]]
        if len(others) < _NEEDED:
            continue
        without, misfit = _fitted(others)
        if misfit <= chi2.isf(_REFUSED, 3 * len(others) - 6):
            there, _ = without.place(point.in_map)
            right.append((misfit, point.name, np.linalg.norm(there - point.on_aircraft) * 1e3))
    if len(right) == 1:
        _, name, off = right[0]
        return (
            f'{said}: without {name}, which is {off:.1f} mm off, they agree: '
            'check its place and its coordinates'
        )
    return f'{said}: check their places and coordinates, or name one more to tell which is wrong'


def _fitted(points: Sequence[ReferencePoint]) -> tuple[AircraftFrame, float]:
    """The frame, and the chi-square of its residuals."""
    here = np.stack([point.in_map for point in points]).astype(float)
    there = np.stack([point.on_aircraft for point in points]).astype(float)
    middle = there.mean(axis=0)
    with warnings.catch_warnings():
        # Of points on a line, which the covariance tells.
        warnings.simplefilter('ignore', UserWarning)
        rotation, _ = Rotation.align_vectors(there - middle, here - here.mean(axis=0))
    pose = Pose(rotation, middle - rotation.apply(here.mean(axis=0)))
    spreads = np.stack([point.map_covariance for point in points])
    own = np.stack([np.eye(3) * point.uncertainty**2 for point in points])
    information, misfit, off = np.eye(6), 0.0, np.zeros_like(here)
    for _ in range(_ROUNDS):
        turn = pose.rotation.as_matrix()
        off = there - pose.apply(here)
        weights = np.linalg.inv(turn @ spreads @ turn.T + own)
        jacobians = np.stack([about(place - middle) for place in pose.apply(here)])
        weighted = jacobians.transpose(0, 2, 1) @ weights
        information = (weighted @ jacobians).sum(axis=0)
        right = (weighted @ off[..., None]).sum(axis=0)[:, 0]
        misfit = float(np.einsum('ni,nij,nj->', off, weights, off))
        # On a line the turn about it is open: no step is taken there.
        step = np.linalg.pinv(information, rcond=1e-12, hermitian=True) @ right
        turned = Rotation.from_rotvec(step[3:])
        move = Pose(turned, middle - turned.apply(middle) + step[:3])
        pose = move @ pose
    values, vectors = np.linalg.eigh(information)
    covariance = (vectors / np.maximum(values, 1e-9)) @ vectors.T
    return AircraftFrame(pose, middle, covariance, off, tuple(points)), misfit
