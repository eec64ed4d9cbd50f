"""What is known of a dent."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose

Vector = NDArray[np.float64]
Points = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A measured value.

    Attributes
    ----------
    value : float
        In SI units; NaN where it could not be measured.
    uncertainty : float
        Standard uncertainty, in the same unit.
    """

    value: float
    uncertainty: float


@dataclass(frozen=True, eq=False)
class MeasuredDent:
    """A place where the skin departs from its undeformed contour, in the frame of its cloud.

    Attributes
    ----------
    kind : str
        ``'dent'`` (smooth, inward), ``'bump'`` (outward) or ``'step'`` (one side of an edge).
    position : ndarray, shape (3,)
        Centre of the 10 % outline, on the undeformed contour, metres.
    normal : ndarray, shape (3,)
        Unit normal of the contour there, outward.
    axis : ndarray, shape (3,)
        Unit vector along the length.
    depth : Estimate
        Along the normal at its largest, metres; positive inward.
    length, width : Estimate
        Longest distance on the contour at 10 % of the depth, and the longest at 90 degrees to it,
        metres.
    model_length, model_width : Estimate
        Full axes of the fitted dent function (eq. 18), metres.
    orientation : Estimate
        Angle of the length axis from the frame's x axis about the normal, -pi/2 to pi/2, radians.
    area, volume : Estimate
        Within the 10 % outline, square and cubic metres.
    significance : float
        Depth over the noise that the detection held it against.
    is_cut : bool
        Whether the rim of the measured area, or a hole, cuts it: its sizes are lower bounds.
    outline : ndarray, shape (n, 3)
        The 10 % contour, closed, on the measured skin, metres.
    length_profile, width_profile : ndarray, shape (n, 2)
        Distance from the centre along each axis, and depth below the contour; metres.
    clearance : float
        From this outline to the next dent's, metres; infinite if there is none.
    """

    kind: str
    position: Vector
    normal: Vector
    axis: Vector
    depth: Estimate
    length: Estimate
    width: Estimate
    model_length: Estimate
    model_width: Estimate
    orientation: Estimate
    area: Estimate
    volume: Estimate
    significance: float
    is_cut: bool
    outline: Points
    length_profile: Points
    width_profile: Points
    clearance: float = float('inf')

    @property
    def width_to_depth(self) -> float:
        """Width over depth, as repair manuals limit it."""
        return self.width.value / self.depth.value

    def transformed(self, pose: Pose) -> MeasuredDent:
        """The same dent in the parent frame of `pose`; the orientation is left as it is."""
        return replace(
            self,
            position=pose.apply(self.position),
            normal=pose.rotation.apply(self.normal),
            axis=pose.rotation.apply(self.axis),
            outline=pose.apply(self.outline),
        )


@dataclass(frozen=True, eq=False)
class Inspection:
    """What was found in one cloud.

    Attributes
    ----------
    dents : tuple of MeasuredDent
        Of kind ``'dent'``, the deepest first.
    others : tuple of MeasuredDent
        Bumps and steps.
    deviation : ndarray, shape (rows, columns)
        Depth of each point of the cloud below the undeformed contour, metres, inward positive;
        NaN where nothing is measured.
    noise : ndarray, shape (rows, columns)
        Its standard deviation, metres.
    """

    dents: tuple[MeasuredDent, ...]
    others: tuple[MeasuredDent, ...]
    deviation: NDArray[np.float32]
    noise: NDArray[np.float32]
