"""What is listed of a place whose bottom was not measured."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ftp_dent_ros.dents.dent import COVERAGE, Estimate, MeasuredDent, SmallestDent, orientation_of
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.detection import Candidate
from ftp_dent_ros.inspection.measuring.places.evidence import SIGNIFICANT
from ftp_dent_ros.inspection.measuring.places.placement import axis_along
from ftp_dent_ros.inspection.measuring.places.surroundings import places
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice

# Part of a candidate that has no points, for that to be why it could not be measured.
_HIDDEN = 0.1
_NAN = Estimate(math.nan, math.nan)


def not_at_bottom(deepest: float, noise: float) -> str:
    """What is said of a depth of which only flanks are measured, down to `deepest` metres."""
    least = max(deepest - COVERAGE * noise, 0.0)
    return f'not measured at its bottom: at least {1e3 * least:.2f} mm deep'


def hidden_dent(
    candidate: Candidate, lattice: Lattice, skin: BareSkin, settings: SmallestDent
) -> list[MeasuredDent]:
    """What departs from the skin beside places without points, with what is known of it.

    Its depth is the largest that was measured. Its sizes are those of the cells that depart, and
    of those between them that have no points.
    """
    cells = len(candidate.rows) + candidate.gap.shape[1]
    hidden = candidate.gap.shape[1] >= _HIDDEN * cells
    if not hidden or candidate.height < settings.smallest_depth:
        return []
    contour = skin.contour
    x, y = places(candidate, lattice, contour)
    across, cell = np.stack([x, y], axis=1).astype(np.float32), max(lattice.spacing)
    _, sides, _ = cv2.minAreaRect(across)
    noise = skin.noise.after(skin.noise.scales[1])[candidate.rows, candidate.columns]
    smooth = skin.maps[0][candidate.rows, candidate.columns]
    deepest = int(np.argmax(np.nan_to_num(candidate.sign * smooth, nan=-math.inf)))
    unsure = float(np.median(noise))
    # Beside a hole the cloud is in doubt, the more the nearer.
    significance = candidate.height / max(unsure, float(noise[deepest]))
    length, width = max(sides) + cell, min(sides) + cell
    if length < settings.smallest_width:
        return []
    if significance < SIGNIFICANT:
        return []
    if skin.relief and candidate.height < SIGNIFICANT * skin.relief.uncertainty(width):
        return []
    corners = cv2.convexHull(across)[:, 0].astype(float)
    centre = across.mean(axis=0, dtype=float)[:, None]
    _, axes = np.linalg.eigh(np.cov(across.T))
    normal = contour.normal(*centre)[0]
    axis = axis_along(contour, normal, math.atan2(axes[1, 1], axes[0, 1]))
    return [
        MeasuredDent(
            kind='other',
            reason=not_at_bottom(candidate.height, unsure),
            position=contour.point(*centre)[0],
            normal=normal,
            axis=axis,
            # A bound, and nothing is known of how far the depth exceeds it.
            depth=Estimate(candidate.sign * candidate.height, candidate.height),
            length=Estimate(length, cell),
            width=Estimate(width, cell),
            model_length=_NAN,
            model_width=_NAN,
            orientation=Estimate(orientation_of(normal, axis), math.pi / math.sqrt(12)),
            area=Estimate(cells * lattice.spacing[0] * lattice.spacing[1], length * cell),
            volume=_NAN,
            bottom_radius=math.nan,
            significance=significance,
            is_cut=True,
            outline=contour.point(*np.concatenate([corners, corners[:1]]).T),
            length_profile=np.zeros((0, 2)),
            width_profile=np.zeros((0, 2)),
        )
    ]
