"""What a survey of an aircraft's skin has found."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ftp_dent_ros.dents.dent import MeasuredDent, SmallestDent, tangent_axes
from ftp_dent_ros.rigid import Array
from ftp_dent_ros.survey.raster import remap


@dataclass(frozen=True, eq=False)
class DentRelief:
    """The skin about a dent as all clouds tell it together.

    Attributes
    ----------
    spacing : float
        Of the grid, metres.
    heights : ndarray, shape (2 n + 1, 2 m + 1), float32
        Along the dent's normal, above the plane through its position, which is in the middle;
        columns go along its axis, rows along normal x axis. Metres; NaN where fewer than two
        clouds tell of it.
    """

    spacing: float
    heights: NDArray[np.float32]

    def places(self) -> tuple[Array, Array]:
        """Places of the grid's points along the columns' axis and the rows', metres."""
        rows, columns = self.heights.shape
        v, u = np.mgrid[:rows, :columns].astype(float)
        return (u - columns // 2) * self.spacing, (v - rows // 2) * self.spacing

    def plane(self, dent: MeasuredDent, slide: Array | tuple[float, float] = (0, 0)) -> Array:
        """Points of the grid, slid along it and across, in the plane through a dent, (..., 3)."""
        across = np.cross(dent.normal, dent.axis)
        aside = np.stack(self.places(), axis=-1) + slide
        return dent.position + aside @ np.stack([dent.axis, across])

    def above(self, places: Array, dent: MeasuredDent) -> Array:
        """Heights of the skin above places of shape (..., 3), by the dent that it is about."""
        off, half = places - dent.position, np.array(self.heights.shape) // 2
        u = off @ dent.axis / self.spacing + half[1]
        v = off @ np.cross(dent.normal, dent.axis) / self.spacing + half[0]
        at = u.astype(np.float32), v.astype(np.float32)
        return remap(self.heights, *at, cv2.INTER_CUBIC) - off @ dent.normal


@dataclass(frozen=True, eq=False)
class SurveyedDent:
    """One dent of a survey.

    Attributes
    ----------
    number : int
        In its survey.
    dent : MeasuredDent
        In the survey's frame; its profiles may be empty.
    position_covariance : ndarray, shape (3, 3)
        Square metres: with what all dents of the survey have in common.
    sightings : int
    relief : DentRelief, optional
        For the comparison with another survey.
    """

    number: int
    dent: MeasuredDent
    position_covariance: Array
    sightings: int
    relief: DentRelief | None = None


@dataclass(frozen=True, eq=False)
class CoverageCells:
    """What of the skin was measured, and how well, as a list of cells on it.

    Attributes
    ----------
    size : float
        Side of a cell, metres.
    positions : ndarray, shape (n, 3), float32
        Their middles in the survey's frame, metres.
    findable : ndarray, shape (n,), float32
        Smallest depth of a dent that would have been found there by the best cloud, metres; NaN
        where it is not known.
    """

    size: float
    positions: NDArray[np.float32]
    findable: NDArray[np.float32]

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.positions)

    def found_around(self, place: Array, normal: Array, radius: float) -> float:
        """Depth from which a dent would have been found wherever it lies about a place.

        Parameters
        ----------
        place, normal : ndarray, shape (3,)
            On the skin.
        radius : float
            How far it may be off along the skin, metres.

        Returns
        -------
        float
            Infinite where a part was not measured, metres.
        """
        if not len(self.positions):
            return math.inf
        # A cell at the rim may be measured only half.
        radius = radius + self.size / 2
        # To the height of the skin there: two maps may differ by more than a cell.
        _, nearest = self._tree.query(place)
        place = place + normal * float((self.positions[nearest] - place) @ normal)
        # Rings, at most a cell apart, and their points.
        rings = np.linspace(0, radius, math.ceil(radius / self.size) + 1)[:, None]
        angles = np.linspace(0, 2 * np.pi, 8 * len(rings), endpoint=False)
        disc = np.stack([rings * np.cos(angles), rings * np.sin(angles)], axis=-1)
        places = place + disc.reshape(-1, 2) @ tangent_axes(normal)[:2]
        # Half a cell's diagonal is 0.7 of its side; the rest is for the skin's curve.
        _, index = self._tree.query(places, distance_upper_bound=self.size)
        # One more for what was not measured.
        depths = np.append(self.findable, np.nan)[index]
        return float(depths.max()) if np.isfinite(depths).all() else math.inf


@dataclass(frozen=True, eq=False)
class SurveyResult:
    """All dents of a survey, and what was looked at.

    Attributes
    ----------
    name : str
    sources : tuple of str
        The bags.
    taken_ns : int
        Time of the first exposure, nanoseconds since 1970.
    frame_id : str
        Frame of all positions.
    dents : tuple of SurveyedDent
    coverage : CoverageCells
    settings : SmallestDent
        The smallest dents that were looked for.
    rig_id : str
        Id of the calibration; empty if it is not known.
    software : str
    """

    name: str
    sources: tuple[str, ...]
    taken_ns: int
    frame_id: str
    dents: tuple[SurveyedDent, ...]
    coverage: CoverageCells
    settings: SmallestDent = field(default_factory=SmallestDent)
    rig_id: str = ''
    software: str = ''

    @property
    def count(self) -> int:
        """How many dents it has, the others apart."""
        return sum(each.dent.kind == 'dent' for each in self.dents)
