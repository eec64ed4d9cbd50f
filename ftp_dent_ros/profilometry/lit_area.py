"""Where the light ends: on the rims of the projector's frame, or before them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.robust import median

#: Fringes within which the ends of rows lie on one column.
PARALLEL = 0.15
# Share of the rows that must.
_SHARE = 0.25
# Fringes beside the image's border within which an end is the image's.
_BORDER = 2.5
# Projector pixels by which the ends of columns scatter about a line; fits of it, each without
# what was off the last; and the share of the ends that must lie on it.
_SCATTER, _FITS, _MOST = 3.0, 4, 0.6
# Projector pixels from the frame's upper or lower rim at which the light's end is seen.
_NEAR = -3.0, 12.0
# Every how many rows are looked at, and ends that must agree.
_EVERY, _LEAST = 2, 6
#: Fringes of the light's end that whole windows leave out: 0.3 to 0.5 in simulation.
WINDOWED = 0.4
# Points that tilt and lines are taken from, about.
_POINTS = 200


@dataclass(frozen=True)
class RimLine:
    """A straight line of the light's ends along a rim of the frame, projector pixels from it.

    Attributes
    ----------
    level : float
        At the stripe.
    rise : float
        From one end to the other.
    lowest : float
        At the end that is farther out; below 0 it is beyond the rim.
    """

    level: float
    rise: float
    lowest: float

    @property
    def on_rim(self) -> bool:
        """Whether it passes the rim where the stripe is, whose place no period changes."""
        return _NEAR[0] < self.level < _NEAR[1]

    @classmethod
    def through(cls, along: NDArray[np.floating], away: NDArray[np.floating]) -> RimLine | None:
        """Line through most of the ends, or None if they lie on none."""
        if len(along) < _LEAST:
            return None
        held = np.ones(len(along), bool)
        for _ in range(_FITS):
            middle = along[held].mean(), away[held].mean()
            spread = along[held] - middle[0]
            slope = float(spread @ away[held]) / max(float(spread @ spread), 1e-12)
            level = middle[1] - slope * middle[0]
            off = np.abs(away - level - slope * along)
            before, held = held, off < max(_SCATTER, 1.5 * median(off))
            if (held == before).all():
                break
        held = off < _SCATTER
        if held.mean() < _MOST:
            return None
        ends = level + slope * np.array([along[held].min(), along[held].max()])
        return cls(float(level), float(np.ptp(ends)), float(ends.min()))


@dataclass(frozen=True, eq=False)
class LitArea:
    """Where a photograph has fringes, and which, under the given pattern.

    Attributes
    ----------
    rig : Rig
    pattern : Pattern
        As given.
    rays : ndarray, shape (rows, columns, 2 or 3), float32
        The camera's undistorted rays, z = 1, through the pixels at which it is known, all over
        the image.
    phase : ndarray, shape (rows, columns)
        Absolute, radians; of `lit` only.
    lit : ndarray, shape (rows, columns), bool
        Where there are fringes that are tied to the stripe.
    short : float
        Fringes of each row's ends that `lit` leaves out.
    """

    rig: Rig
    pattern: Pattern
    rays: NDArray[np.float32]
    phase: NDArray[np.floating]
    lit: NDArray[np.bool_]
    short: float = 0.0

    def u_p(self, row: NDArray[np.intp], column: NDArray[np.intp]) -> NDArray[np.floating]:
        """Projector columns at places."""
        return self.pattern.column(self.phase[row, column])

    def scaled(self, u_p: NDArray, period: float) -> NDArray:
        """Projector columns if the period were another."""
        centre = self.pattern.stripe_center_px
        return centre + (u_p - centre) * (period / self.pattern.period_px)

    def points(
        self, row: NDArray[np.intp], column: NDArray[np.intp], period: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points and projector rows v_p at places, if the period were another; NaN behind."""
        rays = np.ones((1, len(row), 3), np.float32)
        rays[..., :2] = self.rays[row, column, :2]
        u_p = self.scaled(self.u_p(row, column), period)[None].astype(np.float32)
        depth, v_p = triangulate(self.rig, rays, u_p)
        return (rays * depth[..., None])[0].astype(float), v_p[0].astype(float)

    @property
    def sides(self) -> dict[bool, float]:
        """Fringes from the frame's rim at which most rows end, True for that of its last column.

        A side at which the rows do not end on one column is left out.
        """
        return {last: away for last, (away, _) in self.columns.items()}

    @cached_property
    def columns(self) -> dict[bool, tuple[float, float]]:
        """As `sides`, and the share of the rows that end there."""
        found = {}
        row = np.flatnonzero(self.lit[::_EVERY].any(axis=1)) * _EVERY
        lit, count, fringe = self.lit[row], self.lit.shape[1], self.pattern.period_px
        width = max(count // 200, 1)
        for right in (False, True):
            end = count - 1 - lit[:, ::-1].argmax(axis=1) if right else lit.argmax(axis=1)
            inwards = np.clip(end + (-width if right else width), 0, count - 1)
            u_p = self.u_p(row, end)
            step = self.u_p(row, inwards) - u_p
            far = np.minimum(end, count - 1 - end) * np.abs(step) > _BORDER * fringe * width
            if np.count_nonzero(far) < _LEAST:
                continue
            last = median(step[far]) < 0  # else fringes run against the camera's columns
            u_p = u_p - step / (2 * width)  # the light ends where its last bin does
            away = (self.pattern.width - 0.5 - u_p if last else u_p + 0.5)[far] / fringe
            away = np.sort(away)
            held = np.searchsorted(away, away + 2 * PARALLEL) - np.arange(len(away))
            best = int(held.argmax())
            if held[best] >= max(_SHARE * self.lit.shape[0] / _EVERY, _LEAST):
                on_column = away[best : best + held[best]]
                found[last] = median(on_column) - self.short, len(on_column) / len(away)
        return found

    def upper_and_lower(self, period: float) -> dict[str, RimLine]:
        """Lines on which the light ends above and below, if the period were another."""
        lines, count = {}, self.lit.shape[0]
        # Along rows of the turned mask ends are found many times as fast.
        turned: Any = cv2.transpose(self.lit.view(np.uint8))
        lit, any_lit = turned.view(bool), self.lit.any(axis=0)
        for side in ('upper', 'lower'):
            bottom = side == 'lower'
            end = count - 1 - lit[:, ::-1].argmax(axis=1) if bottom else lit.argmax(axis=1)
            column = np.flatnonzero(any_lit & (end > 2) & (end < count - 3))
            if len(column) < _SHARE * self.lit.shape[1]:
                continue
            column = column[:: max(1, len(column) // _POINTS)]
            _, v_p = self.points(end[column], column, period)
            away = self.rig.projector.height - 0.5 - v_p if bottom else v_p + 0.5
            along = self.u_p(end[column], column) - self.pattern.stripe_center_px
            met = np.isfinite(away)
            line = RimLine.through(along[met] / self.pattern.width, away[met])
            if line is not None:
                lines[side] = line
        return lines

    def tilt(self, period: float) -> float:
        """Angle between the surface's normal and the way to camera and projector, degrees."""
        place = np.flatnonzero(self.lit)
        place = place[:: max(1, len(place) // _POINTS)]
        points, _ = self.points(*np.divmod(place, self.lit.shape[1]), period)
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 6:
            return 90.0
        middle = np.median(points, axis=0)
        # On a plane the inverse depth, which errs evenly, is linear in the rays.
        inverse = 1 / points[:, 2:]
        normal = np.linalg.lstsq(points * inverse, inverse[:, 0], rcond=None)[0]
        normal /= np.linalg.norm(normal)
        to_projector = self.rig.projector_centre - middle
        way = to_projector / np.linalg.norm(to_projector) - middle / np.linalg.norm(middle)
        cosine = abs(float(normal @ way)) / float(np.linalg.norm(way))
        return math.degrees(math.acos(min(cosine, 1.0)))
