"""Steps between panels: laps, and edges of doublers and patches."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import Estimate, MeasuredDent, SmallestDent, orientation_of
from ftp_dent_ros.inspection.measuring.dent_model import UNKNOWN
from ftp_dent_ros.inspection.measuring.lattice import CELLS, Lattice
from ftp_dent_ros.inspection.measuring.measurement import axis_along
from ftp_dent_ros.inspection.measuring.noise import SURE
from ftp_dent_ros.inspection.measuring.outline import closed
from ftp_dent_ros.inspection.measuring.segmentation import Segment
from ftp_dent_ros.robust import deviation, median

_PLATE = 'all round a plate that lies on the skin, as a doubler or a patch'
_SUNK = 'all round what lies flat below the skin: a dent, or another skin in an opening'

Mask = NDArray[np.bool_]


def find_steps(
    lattice: Lattice, panels: list[Segment], seams: Mask, settings: SmallestDent
) -> list[MeasuredDent]:
    """Steps where a panel beside its seam with a larger one stands apart from that one's contour.

    The contour of a strip is not carried over its blurred edge, for nothing holds it there.
    """
    steps = []
    kernel = np.ones((3, 3), np.uint8)
    by_size = sorted(panels, key=lambda each: -int(each.mask.sum()))
    for larger, smaller in combinations(by_size, 2):
        at = (cv2.dilate(larger.mask.astype(np.uint8), kernel) > 0) & smaller.mask
        free = smaller.mask & ~seams
        if at.sum() * max(lattice.spacing) < settings.smallest_width or not free.any():
            continue
        far = cv2.distanceTransform((~at).astype(np.uint8), cv2.DIST_L2, 3)
        beside = free & (far <= far[free].min() + CELLS)
        points = lattice.points[beside]
        apart = np.abs(larger.contour.depth(points))
        height = median(apart)
        spread = deviation(apart - height)
        if height >= max(settings.smallest_depth, SURE * spread):
            seam = _Seam(larger, lattice.points[at])
            along = seam.profile(0, points, apart, settings.smallest_width)
            across = seam.profile(1, points, apart, max(lattice.spacing))
            # One stretch's error has nothing to do with the next one's; what the edge rings
            # by is the same all along it.
            uncertainty = math.hypot(spread / math.sqrt(len(along)), across[:, 1].std())
            step = _step(seam, along, Estimate(height, uncertainty), spread)
            # All that lies around a plate is one panel.
            if closed(larger.mask)[smaller.mask].all():
                step = _around(step, lattice, larger, smaller)
            steps.append(step)
    return steps


class _Seam:
    """The cells of a border between two panels, as a line on one of them."""

    def __init__(self, panel: Segment, points: NDArray) -> None:
        self.panel = panel
        x, y = self._local(points).T
        self.centre = np.array([x.mean(), y.mean()])
        _, axes = np.linalg.eigh(np.cov(np.stack([x, y])) + 1e-12 * np.eye(2))
        # Along it, and across.
        self.directions = axes[:, 1], axes[:, 0]
        place = self._places(points, 0)
        self.length = float(np.ptp(place))
        order = np.argsort(place)
        self.outline = panel.contour.foot(x[order], y[order])[0]

    def profile(
        self, way: int, points: NDArray, heights: NDArray, width: float
    ) -> NDArray[np.float64]:
        """Places along (0) or across (1) the seam and the medians there, in steps of a width."""
        stretch = np.floor(self._places(points, way) / width).astype(int)
        numbers = np.unique(stretch)
        medians = [median(heights[stretch == number]) for number in numbers]
        return np.stack([(numbers + 0.5) * width, medians], axis=1)

    def _places(self, points: NDArray, way: int) -> NDArray[np.float64]:
        """How far points lie from its middle, metres."""
        return (self._local(points) - self.centre) @ self.directions[way]

    def _local(self, points: NDArray) -> NDArray[np.float64]:
        x, y, _ = self.panel.contour.local(points)
        return np.stack([x, y], axis=1).astype(float)


def _step(seam: _Seam, profile: NDArray, height: Estimate, spread: float) -> MeasuredDent:
    contour = seam.panel.contour
    at = seam.centre[:1], seam.centre[1:]
    along, _ = seam.directions
    (position,), (normal,) = contour.foot(*at)
    return MeasuredDent(
        kind='step',
        position=position,
        normal=normal,
        axis=along[0] * contour.axes[0] + along[1] * contour.axes[1],
        depth=height,
        length=Estimate(seam.length, contour.scale / 100),
        width=UNKNOWN,
        model_length=UNKNOWN,
        model_width=UNKNOWN,
        orientation=UNKNOWN,
        area=UNKNOWN,
        volume=UNKNOWN,
        bottom_radius=math.nan,
        significance=height.value / max(spread, 1e-9),
        is_cut=True,
        outline=seam.outline,
        length_profile=profile,
        width_profile=np.zeros((0, 2)),
    )


def _around(step: MeasuredDent, lattice: Lattice, panel: Segment, plate: Segment) -> MeasuredDent:
    """The step all round a plate, with the plate's place and sizes."""
    contour, cell = panel.contour, max(lattice.spacing)
    x, y, depth = contour.deviation(lattice.points[plate.mask])
    # Its edge is where half of the step is.
    x, y = (each[np.abs(depth) > step.depth.value / 2] for each in (x, y))
    middle, sides, degrees = cv2.minAreaRect(np.stack([x, y], axis=1).astype(np.float32))
    angle = math.radians(degrees) + (math.pi / 2 if sides[0] < sides[1] else 0.0)
    # Cells reach half a cell beyond their middles, and each edge errs by as much.
    length, width = (Estimate(side + cell, cell) for side in (max(sides), min(sides)))
    at = np.array(middle)[:, None]
    (position,), (normal,) = contour.foot(*at)
    axis = axis_along(contour, normal, angle)
    corners = cv2.boxPoints((middle, (sides[0] + cell, sides[1] + cell), degrees)).astype(float)
    return replace(
        step,
        reason=_SUNK if median(depth) > 0 else _PLATE,
        position=position,
        normal=normal,
        axis=axis,
        length=length,
        width=width,
        orientation=Estimate(orientation_of(normal, axis), cell / length.value),
        area=Estimate(plate.mask.sum() * math.prod(lattice.spacing), length.value * cell),
        is_cut=False,
        outline=contour.foot(*np.concatenate([corners, corners[:1]]).T)[0],
    )
