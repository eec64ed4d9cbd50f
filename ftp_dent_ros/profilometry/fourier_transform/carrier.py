"""The carrier: the fringes' frequency along the camera's rows, and the band around it.

The paper's automatic band-pass (eq. 1-4) follows from the depth of the red stripe alone. To find
the stripe in the first place, a coarse carrier is read off the image's own spectrum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from ftp_dent_ros.errors import RigError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.rig.rig import Rig

# Tilt and distance stretch the fringes by less than this against parallel, square views.
_STRETCH = 2.0
# Share by which the fringes' frequency may differ from the reference plane's.
_FITS = 0.15
_SLOPES = np.arange(-40, 41) / 20
# Below this the band reaches past half the sampling frequency.
_SHORTEST_PERIOD = 3.0


@dataclass(frozen=True)
class Carrier:
    """Spatial frequency of the fringes along the camera's rows.

    Attributes
    ----------
    frequency : float
        f_c, cycles per pixel, positive.
    sign : int
        1 if the projector's columns run with the camera's, -1 if against them.
    """

    frequency: float
    sign: int = 1

    @property
    def period(self) -> float:
        """T_c, pixels."""
        return 1 / self.frequency

    @property
    def radius(self) -> float:
        """Half width r of the pass band, cycles per pixel: f_c / 2 (section 2.2)."""
        return self.frequency / 2


@dataclass(frozen=True)
class ReferencePlane:
    """The virtual reference plane z = depth + slope x in the camera's frame.

    Attributes
    ----------
    depth : float
        l_c, metres.
    slope : float
        0 as in the paper, but for surfaces that are tilted beyond the pass band.
    """

    depth: float
    slope: float = 0.0


def carrier_on(rig: Rig, pattern: Pattern, plane: ReferencePlane) -> Carrier:
    """Carrier on a plane around the camera's optical axis (eq. 1-4).

    Raises
    ------
    RigError
        The fringes run along the camera's rows, or are too fine for its pixels.
    """
    panel = np.array([rig.projector.width, rig.projector.height]) - 1.0
    centre = rig.projector.project(rig.to_projector([0.0, 0.0, plane.depth]))
    half = pattern.period_px / 2
    centre = np.clip(centre, [half, 0], [panel[0] - half, panel[1]])
    ends = centre + np.array([[-half, 0], [half, 0]])
    ray = rig.projector.rays(ends) @ rig.rotation
    x, _, z = rig.projector_centre
    reach = (plane.depth + plane.slope * x - z) / (ray[:, 2] - plane.slope * ray[:, 0])
    points = rig.projector_centre + ray * reach[:, None]
    period = np.diff(rig.camera.project(points)[:, 0])[0]
    if not abs(period) >= _SHORTEST_PERIOD:
        raise RigError(
            f'a fringe of {pattern.period_px:g} projector pixels is {abs(period):.1f} camera '
            f'pixels wide along the rows at {plane.depth:.2f} m: mount the projector upright '
            'beside the camera, or use a longer period'
        )
    return Carrier(1 / abs(period), 1 if period > 0 else -1)


def plane_through(
    rig: Rig, pattern: Pattern, points: NDArray[np.floating], seen: Carrier
) -> ReferencePlane:
    """Virtual reference plane through the stripe, square to the camera's axis if that will do.

    It will if the fringes `seen` fit the flat part of the pass band around the plane's carrier.
    Else the plane is turned about the vertical until its carrier is theirs.

    Parameters
    ----------
    points : ndarray, shape (points, 3)
        On the stripe, metres.
    seen : Carrier
        As measured in the image.
    """
    middle = np.median(points, axis=0)
    square = ReferencePlane(float(middle[2]))
    ratio = seen.frequency / carrier_on(rig, pattern, square).frequency
    if abs(ratio - 1) < _FITS:
        return square

    def misfit(plane: ReferencePlane) -> float:
        try:
            return abs(np.log(seen.frequency / carrier_on(rig, pattern, plane).frequency))
        except RigError:
            return np.inf

    turned = (ReferencePlane(middle[2] - slope * middle[0], slope) for slope in _SLOPES)
    return min((square, *turned), key=misfit)


def measured_carrier(red: NDArray[np.float32], rig: Rig, pattern: Pattern) -> Carrier:
    """Carrier read off the mean spectrum of the rows; what the rig suggests if they are even.

    Parameters
    ----------
    red : ndarray, shape (rows, columns), float32
        Red channel, or averages of its rows.

    Raises
    ------
    RigError
        As `carrier_on`.
    """
    # At any depth well beyond the baseline the fringes are about as wide as this.
    far = ReferencePlane(4 * float(np.linalg.norm(rig.translation)))
    nominal = carrier_on(rig, pattern, far)
    size = scipy.fft.next_fast_len(2 * red.shape[1], real=True)
    level = red - red.mean(axis=1, keepdims=True)
    power = np.square(np.abs(scipy.fft.rfft(level, size, axis=1))).mean(axis=0)
    frequency = scipy.fft.rfftfreq(size)
    power[np.abs(np.log(np.maximum(frequency, 1e-9) / nominal.frequency)) > np.log(_STRETCH)] = 0
    if not power.any():
        return nominal
    return Carrier(float(frequency[np.argmax(power)]), nominal.sign)
