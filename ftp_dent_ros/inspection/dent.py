"""What is known of a dent."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose

# A new one goes to the end: messages hold their indices.
KINDS = ('dent', 'bump', 'step', 'crease', 'gouge', 'other')
#: Standard uncertainties to either side that hold 95 % of a normal distribution.
COVERAGE = 1.96

Vector = NDArray[np.float64]
Points = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A measured value: one whose uncertainty is not known is not measured either.

    Attributes
    ----------
    value : float
        In SI units; NaN where it could not be measured.
    uncertainty : float
        Standard uncertainty, in the same unit; NaN where there is no value.
    """

    value: float
    uncertainty: float

    def __post_init__(self) -> None:
        if math.isnan(self.value) or not 0 <= self.uncertainty < math.inf:
            object.__setattr__(self, 'value', math.nan)
            object.__setattr__(self, 'uncertainty', math.nan)

    @property
    def is_measured(self) -> bool:
        """Whether there is a value, with its uncertainty."""
        return not math.isnan(self.value)


@dataclass(frozen=True, eq=False)
class MeasuredDent:
    """A place where the skin departs from its undeformed contour, in the frame of its cloud.

    Attributes
    ----------
    kind : str
        One of `KINDS`; `ftp_dent_ros.inspection.measuring.places.kinds` states the rules.
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
    bottom_radius : float
        Smallest radius of curvature at the deepest place, as far as it is resolved, metres.
    significance : float
        Depth over the noise that the detection held it against.
    is_cut : bool
        Whether the rim of the measured area, or a hole, cuts it: its sizes are lower bounds, or
        carried on over the hole.
    outline : ndarray, shape (n, 3)
        The 10 % contour, closed, on the measured skin, metres.
    length_profile, width_profile : ndarray, shape (n, 2)
        Distance from the centre along each axis, and depth below the contour; metres.
    reason : str
        Where the kind, or its being one dent, is in doubt: why. Of a step: if it is all round a
        plate, whose length, width and area are then told.
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
    bottom_radius: float
    significance: float
    is_cut: bool
    outline: Points
    length_profile: Points
    width_profile: Points
    reason: str = ''
    clearance: float = float('inf')

    @property
    def width_to_depth(self) -> float:
        """Width over depth, as repair manuals limit it."""
        return self.width.value / self.depth.value

    def transformed(self, pose: Pose) -> MeasuredDent:
        """The same dent in the parent frame of `pose`, the orientation from its x axis."""
        normal, axis = pose.rotation.apply(self.normal), pose.rotation.apply(self.axis)
        return replace(
            self,
            position=pose.apply(self.position),
            normal=normal,
            axis=axis,
            orientation=replace(self.orientation, value=orientation_of(normal, axis)),
            outline=pose.apply(self.outline),
        )


def orientation_of(normal: Vector, axis: Vector) -> float:
    """Angle about the normal from the frame's x axis, as it lies on the skin, to the axis."""
    x = np.array([1.0, 0, 0]) - normal * normal[0]
    if np.linalg.norm(x) < 1e-6:
        x = np.array([0, 1.0, 0])
    angle = math.atan2(float(np.linalg.det([x, axis, normal])), float(x @ axis))
    return (angle + math.pi / 2) % math.pi - math.pi / 2


@dataclass(frozen=True, eq=False)
class Waviness:
    """What is told of a panel's waviness.

    Attributes
    ----------
    amplitude : float
        Of the sine with the same root mean square, metres.
    wavelength : float
        That carries the most, metres.
    area : float
        Of the panel, square metres.
    """

    amplitude: float
    wavelength: float
    area: float


@dataclass(frozen=True, eq=False)
class Inspection:
    """What was found in one cloud.

    Attributes
    ----------
    dents : tuple of MeasuredDent
        Of kind ``'dent'``, the deepest first.
    others : tuple of MeasuredDent
        Creases, gouges, bumps, steps, and what is none of these.
    waviness : tuple of Waviness
        Of the panels that are wavy; what is told of dents is beside it.
    deviation : ndarray, shape (rows, columns)
        Depth of each point of the cloud below the undeformed contour, metres, inward positive;
        NaN where nothing is measured.
    noise : ndarray, shape (rows, columns)
        Its standard deviation, metres.
    findable : ndarray, shape (rows, columns)
        Depth from which a dent of the smallest width would have been listed as a dent in 95 % of
        cases there, metres, `kinds.STEEP` widths at most; but where the rim of what is measured
        cuts it: then `kinds.AT_RIM` smallest depths at least.
    """

    dents: tuple[MeasuredDent, ...]
    others: tuple[MeasuredDent, ...]
    waviness: tuple[Waviness, ...]
    deviation: NDArray[np.float32]
    noise: NDArray[np.float32]
    findable: NDArray[np.float32]
