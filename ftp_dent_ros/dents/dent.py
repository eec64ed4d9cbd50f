"""What is known of a dent and of all that one cloud shows."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.fields import Checked, Limits
from ftp_dent_ros.pose import Pose

# Metres: below, nothing is resolved by any camera; beyond, it is no dent or fills the view.
RANGES = {'smallest_depth': (1e-6, 0.1), 'smallest_width': (1e-4, 1.0)}

# A new one goes to the end: messages hold their indices.
KINDS = ('dent', 'bump', 'step', 'crease', 'gouge', 'other')
#: Standard uncertainties to either side that hold 95 % of a normal distribution.
COVERAGE = 1.96

Vector = NDArray[np.float64]
Points = NDArray[np.float64]
Profile = NDArray[np.float64]
# Their shapes in a file.
_SHAPES = {'Vector': (3,), 'Points': (-1, 3), 'Profile': (-1, 2)}


@dataclass(frozen=True)
class SmallestDent(Checked):
    """The smallest dent that is looked for.

    Attributes
    ----------
    smallest_depth : float
        Shallower ones are not reported, however significant, metres; of those that the rim cuts,
        four times that, and eight times of those that lie along it.
    smallest_width : float
        Of the 10 % contour: narrower ones are rivets, scratches and gaps; metres.

    Raises
    ------
    ConfigurationError
        A value is no number, or outside `RANGES`.
    """

    smallest_depth: Annotated[float, Limits(*RANGES['smallest_depth'])] = 1e-4
    smallest_width: Annotated[float, Limits(*RANGES['smallest_width'])] = 0.01


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
        One of `KINDS`; `ftp_dent_ros.inspection.measuring.kinds` states the rules.
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
        plate, whose length, width and area are then given.
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
    length_profile: Profile
    width_profile: Profile
    reason: str = ''
    clearance: float = float('inf')

    @property
    def closed_outline(self) -> Points:
        """The outline, shape (n, 3); its place alone if it has none."""
        return self.outline if len(self.outline) else self.position[None]

    @property
    def width_to_depth(self) -> Estimate:
        """Width over depth, as repair manuals limit it, with the uncertainties of both."""
        width, depth = self.width, self.depth
        if not depth.value:
            return Estimate(math.nan, math.nan)
        relative = math.hypot(width.uncertainty / width.value, depth.uncertainty / depth.value)
        ratio = width.value / depth.value
        return Estimate(ratio, abs(ratio) * relative)

    @property
    def clearance_estimate(self) -> Estimate:
        """Distance to the next dent; each outline is as uncertain as half its dent's length."""
        # The other outline is about as uncertain as this one.
        return Estimate(self.clearance, self.length.uncertainty / 2 * math.sqrt(2))

    def figures(self, names: Iterable[str]) -> dict[str, float]:
        """Estimates by their names in files, each with its standard uncertainty.

        Parameters
        ----------
        names : iterable of str
            Of `FIGURES`.
        """
        record: dict[str, float] = {}
        for name in names:
            figure = self.figure(name)
            record |= {name: figure.value, uncertain(name): figure.uncertainty}
        return record

    def figure(self, name: str) -> Estimate:
        """One of `FIGURES`, in the unit of its name."""
        attribute, factor = FIGURES[name]
        estimate = getattr(self, attribute)
        return Estimate(estimate.value * factor, estimate.uncertainty * factor)

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


#: Names of a dent's estimates in files: attribute of `MeasuredDent`, and factor from SI units.
FIGURES = {
    'length_mm': ('length', 1e3),
    'width_mm': ('width', 1e3),
    'depth_mm': ('depth', 1e3),
    'width_to_depth': ('width_to_depth', 1.0),
    'orientation_deg': ('orientation', 180 / math.pi),
    'area_mm2': ('area', 1e6),
    'volume_mm3': ('volume', 1e9),
    'model_length_mm': ('model_length', 1e3),
    'model_width_mm': ('model_width', 1e3),
    'clearance_mm': ('clearance_estimate', 1e3),
}


def uncertain(name: str) -> str:
    """Name of the standard uncertainty of one of `FIGURES`: before the unit."""
    return re.sub(r'((_mm|_deg)\d?)?$', r'_uncertainty\1', name, count=1)


def tangent_axes(normal: Vector) -> NDArray[np.float64]:
    """Two axes along a plane, and its unit normal, shape (3, 3)."""
    normal = normal / np.linalg.norm(normal)
    along = np.eye(3)[int(np.argmin(np.abs(normal)))]
    along = along - normal * (along @ normal)
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along), normal])


def orientation_of(normal: Vector, axis: Vector) -> float:
    """Angle about the normal from the frame's x axis, as it lies on the skin, to the axis."""
    x = np.array([1.0, 0, 0]) - normal * normal[0]
    if np.linalg.norm(x) < 1e-6:
        x = np.array([0, 1.0, 0])
    angle = math.atan2(float(np.linalg.det([x, axis, normal])), float(x @ axis))
    return (angle + math.pi / 2) % math.pi - math.pi / 2


@dataclass(frozen=True, eq=False)
class Waviness:
    """How wavy a panel is.

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
        Creases, bumps, steps, and what is none of these.
    waviness : tuple of Waviness
        Of the panels that are wavy; dents are measured beside it.
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


def dent_to_plain(dent: MeasuredDent) -> dict[str, Any]:
    """Every field; estimates as value and uncertainty."""
    record: dict[str, Any] = {}
    for field in fields(dent):
        value = getattr(dent, field.name)
        if isinstance(value, Estimate):
            value = [value.value, value.uncertainty]
        elif isinstance(value, np.ndarray):
            # Decimals of outlines and profiles, metres: they are for drawing.
            value = (np.round(value, 7) if value.ndim == 2 else value).tolist()
        elif isinstance(value, np.generic):
            value = value.item()
        record[field.name] = value
    return record


def dent_from_plain(record: dict[str, Any]) -> MeasuredDent:
    """The dent again.

    Raises
    ------
    KeyError, TypeError, ValueError
        It is no such record.
    """
    values = dict(record)
    for field in fields(MeasuredDent):
        value = values[field.name]
        if field.type == 'Estimate':
            values[field.name] = Estimate(*value)
        elif field.type in _SHAPES:
            values[field.name] = np.array(value, float).reshape(_SHAPES[field.type])
    return MeasuredDent(**values)


def with_clearances(dents: Sequence[MeasuredDent]) -> tuple[MeasuredDent, ...]:
    """The dents, each with its clearance to the nearest of kind ``'dent'``."""
    from scipy.spatial.distance import cdist  # what only names dents does without

    outlines = [dent.closed_outline for dent in dents]
    centres = np.array([outline.mean(axis=0) for outline in outlines]).reshape(-1, 3)
    reach = np.array(
        [
            np.linalg.norm(outline - centre, axis=1).max()
            for outline, centre in zip(outlines, centres, strict=True)
        ]
    )
    # No two outlines come closer than this.
    bounds = cdist(centres, centres) - reach - reach[:, None]
    limits = np.array([dent.kind == 'dent' for dent in dents], bool)
    bounds[:, ~limits] = math.inf
    np.fill_diagonal(bounds, math.inf)

    result = []
    for dent, outline, bound in zip(dents, outlines, bounds, strict=True):
        nearest = math.inf
        for other in np.argsort(bound):
            if bound[other] >= nearest:
                break
            nearest = min(nearest, cdist(outline, outlines[other]).min())
        result.append(replace(dent, clearance=float(nearest)))
    return tuple(result)
