"""The aircraft's own coordinates, from points of the map whose coordinates on it are known.

Station (fore and aft), buttock line (sideways) and water line (height) of three points or more
give the rigid motion from the map to the aircraft by least squares, weighted by both sides'
uncertainties, and with it the covariance of every place. Source: W. Kabsch, Acta Cryst. A32, 922
(1976).
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.fields import Fields, Positive, Triple
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import Array, about
from ftp_dent_ros.survey.result import SurveyResult
from ftp_dent_ros.yaml_file import read_yaml

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
    on_aircraft : ndarray, shape (3,)
        Station, buttock line, water line; metres.
    uncertainty : float
        Standard uncertainty along each axis, of the place in the map and that on the aircraft
        together, metres.
    """

    name: str
    in_map: Array
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
    """

    pose: Pose
    middle: Array
    covariance: Array
    residuals: Array

    @property
    def worst(self) -> float:
        """Largest residual, metres."""
        return float(np.linalg.norm(self.residuals, axis=1).max())

    def place(self, position: Array, variance: float = 0.0) -> tuple[Array, Array]:
        """A place of the map on the aircraft, and its covariance.

        Parameters
        ----------
        position : ndarray, shape (3,)
        variance : float
            Of the place among the others of the map, along each axis, square metres.
        """
        there = self.pose.apply(np.asarray(position, float))
        jacobian = about(there - self.middle)
        return there, jacobian @ self.covariance @ jacobian.T + variance * np.eye(3)


def aircraft_frame(points: Sequence[ReferencePoint]) -> AircraftFrame:
    """Fit the frame.

    Raises
    ------
    ConfigurationError
        There are fewer than three points, they lie on a line, or they contradict each other; the
        message names the one that does, where four or more tell.
    """
    if len(points) < 3:
        raise ConfigurationError(
            f'{len(points)} reference points do not give a frame: name 3 or more'
        )
    frame, misfit = _fitted(points)
    turns = np.sqrt(np.linalg.eigvalsh(frame.covariance[3:, 3:]))
    # A turn that the points leave open by more than this standard deviation, radians, is no frame:
    # places beside the points are then off by a twentieth of their distance, and no longer
    # linearly.
    if not turns[-1] < 0.05:
        raise ConfigurationError(
            'the reference points lie on a line, or nearly, or too close together: the frame can '
            f'still turn by {math.degrees(turns[-1]):.1f} degrees (standard deviation): name '
            'another point, far off that line'
        )
    if misfit > chdtri(3 * len(points) - 6, _REFUSED):
        raise ConfigurationError(_contradiction(points, frame))
    return frame


def _contradiction(points: Sequence[ReferencePoint], frame: AircraftFrame) -> str:
    said = (
        f'the reference points contradict each other by up to {frame.worst * 1e3:.1f} mm, more '
        'than their uncertainties allow'
    )
    fits = [(_fitted([each for each in points if each is not left]), left) for left in points]
    # Of three points that are left, and of no two.
    most = chdtri(3 * len(points) - 9, _REFUSED)
    right = [(without, left) for (without, misfit), left in fits if misfit <= most]
    if len(right) == 1:
        ((without, point),) = right
        off = np.linalg.norm(without.place(point.in_map)[0] - point.on_aircraft) * 1e3
        return (
            f'{said}: without {point.name}, which is {off:.1f} mm off, they agree: '
            'check its place and its coordinates'
        )
    return f'{said}: check their places and coordinates, or name one more to tell which is wrong'


def _fitted(points: Sequence[ReferencePoint]) -> tuple[AircraftFrame, float]:
    """The frame, and the chi-square of its residuals."""
    here = np.stack([point.in_map for point in points]).astype(float)
    there = np.stack([point.on_aircraft for point in points]).astype(float)
    weights = np.array([point.uncertainty for point in points]) ** -2.0
    start, middle = (np.average(each, axis=0, weights=weights) for each in (here, there))
    with warnings.catch_warnings():
        # Of points on a line, which the covariance tells.
        warnings.simplefilter('ignore', UserWarning)
        rotation, _ = Rotation.align_vectors(there - middle, here - start, weights)
    pose = Pose(rotation, middle - rotation.apply(start))
    off = there - pose.apply(here)
    misfit = float(weights @ np.square(off).sum(axis=1))
    jacobians = about(pose.apply(here) - middle)
    information = np.einsum('n,nij,nik->jk', weights, jacobians, jacobians)
    covariance = np.linalg.inv(information + 1e-9 * np.eye(6))
    return AircraftFrame(pose, middle, covariance, off), misfit


def read_reference_points(
    path: str | os.PathLike[str], survey: SurveyResult
) -> tuple[ReferencePoint, ...]:
    """Read the file for a survey.

    Raises
    ------
    ConfigurationError
        A field is missing, unknown or malformed, or names a dent that the survey has not.
    """
    file = Fields(read_yaml(path, ConfigurationError), f'{path}: ')
    unit = file.choice('unit', {'mm': 1e-3, 'in': 25.4e-3}, 'mm')
    # Millimetres: of a drawing's coordinates as they are found on the skin; and of a place in a
    # map, a pixel of the skin's image or a dent's centre.
    usual = {
        name: file.take(name, Positive, value)
        for name, value in (('uncertainty_mm', 1.0), ('map_uncertainty_mm', 0.5))
    }
    places = {each.number: each.dent.position for each in survey.dents}
    points = []
    for index, each in enumerate(file.blocks('points')):
        if 'dent' in each:
            number = each.take('dent', int)
            if number not in places:
                known = f'a dent of the survey {survey.name}, which has no such dent'
                raise each.refusal('dent', number, known)
            place = places[number]
        else:
            place = np.array(each.take('map', Triple))
        name = each.take('name', str, f'points[{index}]')
        there = np.array(each.take('at', Triple)) * unit
        parts = [each.take(part, Positive, value) * 1e-3 for part, value in usual.items()]
        points.append(ReferencePoint(name, place, there, math.hypot(*parts)))
        each.finish()
    file.finish()
    return tuple(points)
