"""The aircraft's own coordinates, from points of the map whose coordinates on it are known.

Station (fore and aft), buttock line (sideways) and water line (height) of three points or more
give the rigid motion from the map to the aircraft by least squares, weighted by both sides'
uncertainties, and with it the covariance of every place (Gauss and Newton's steps; the start is
that of W. Kabsch, Acta Cryst. A32, 922, 1976).
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import about, move_about
from ftp_dent_ros.survey.result import SurveyResult
from ftp_dent_ros.yaml_file import read_yaml

Array = NDArray[np.float64]

# Points that tell a frame, and rounds of its adjustment.
_NEEDED = 3
_ROUNDS = 4
# Chance that right points are refused as contradicting each other.
_REFUSED = 1e-3

_UNITS = {'mm': 1e-3, 'in': 25.4e-3}
# Millimetres: of a drawing's coordinates as they are found on the skin; and of a place in a map, a
# pixel of the skin's image or a dent's centre.
_ON_AIRCRAFT, _IN_MAP = 1.0, 0.5
_FIELDS = ('name', 'map', 'dent', 'at', 'uncertainty_mm', 'map_uncertainty_mm')


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
    # A turn that the points leave open by more than this standard deviation, radians, is no frame:
    # places beside the points are then off by a twentieth of their distance, and no longer
    # linearly.
    if not turns[-1] < 0.05:
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
    for index, point in enumerate(points if len(points) > _NEEDED else ()):
        without, misfit = _fitted([*points[:index], *points[index + 1 :]])
        if misfit <= chi2.isf(_REFUSED, 3 * len(points) - 9):
            right.append((point, without))
    if len(right) == 1:
        ((point, without),) = right
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
        pose = move_about(step, middle) @ pose
    values, vectors = np.linalg.eigh(information)
    covariance = (vectors / np.maximum(values, 1e-9)) @ vectors.T
    return AircraftFrame(pose, middle, covariance, off, tuple(points)), misfit


def read_reference_points(
    path: str | os.PathLike[str], survey: SurveyResult
) -> tuple[ReferencePoint, ...]:
    """Read the file for a survey.

    Raises
    ------
    ConfigurationError
        A field is missing, unknown or malformed, or names a dent that the survey has not.
    """
    data = read_yaml(path, ConfigurationError)
    try:
        _refuse_unknown(data, ('unit', 'uncertainty_mm', 'map_uncertainty_mm', 'points'), '')
        unit = data.get('unit', 'mm')
        if unit not in _UNITS:
            raise ConfigurationError(f'unit is {unit!r}: give mm or in')
        points = data.get('points')
        if not isinstance(points, list) or not points:
            raise ConfigurationError('points is no list of points: give three or more')
        return tuple(
            _point(each, f'points[{index}]', data, _UNITS[unit], survey)
            for index, each in enumerate(points)
        )
    except ConfigurationError as reason:
        raise ConfigurationError(f'{path}: {reason}') from None


def _point(
    item: Any, where: str, data: dict[str, Any], unit: float, survey: SurveyResult
) -> ReferencePoint:
    if not isinstance(item, dict):
        raise ConfigurationError(f'{where} is {item!r}: give at, and map or dent')
    _refuse_unknown(item, _FIELDS, f'{where}.')
    if ('map' in item) == ('dent' in item):
        raise ConfigurationError(f'{where} has both of map and dent, or none: give one of them')
    if 'dent' in item:
        found = [each for each in survey.dents if each.number == item['dent']]
        if not found:
            raise ConfigurationError(
                f'{where}.dent is {item["dent"]!r}: the survey {survey.name} has no such dent'
            )
        place = found[0].dent.position
    else:
        place = _place(item['map'], f'{where}.map')
    spread = _positive(item, data, 'map_uncertainty_mm', _IN_MAP, where) * 1e-3
    return ReferencePoint(
        str(item.get('name', where)),
        place,
        np.eye(3) * spread**2,
        _place(item.get('at'), f'{where}.at') * unit,
        _positive(item, data, 'uncertainty_mm', _ON_AIRCRAFT, where) * 1e-3,
    )


def _place(value: Any, where: str) -> NDArray[np.float64]:
    if not isinstance(value, list) or len(value) != 3 or not all(map(_is_number, value)):
        raise ConfigurationError(f'{where} is {value!r}: give three numbers')
    return np.array(value, float)


def _positive(
    item: dict[str, Any], data: dict[str, Any], name: str, default: float, where: str
) -> float:
    value = item.get(name, data.get(name, default))
    if not _is_number(value) or not value > 0:
        raise ConfigurationError(f'{where}: {name} is {value!r}: give millimetres, above 0')
    return float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _refuse_unknown(data: dict[Any, Any], known: Sequence[str], where: str) -> None:
    for name in data:
        if name not in known:
            raise ConfigurationError(f'{where}{name} is unknown: only {", ".join(known)} are')
