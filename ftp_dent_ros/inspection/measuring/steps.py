"""Steps between panels: laps and edges of doublers."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import Estimate, MeasuredDent
from ftp_dent_ros.inspection.measuring.detection import SIGNIFICANT
from ftp_dent_ros.inspection.measuring.lattice import Lattice
from ftp_dent_ros.inspection.measuring.panels import Panel
from ftp_dent_ros.inspection.settings import Settings

_NAN = Estimate(math.nan, math.nan)


def find_steps(
    lattice: Lattice,
    panels: list[Panel],
    labels: NDArray[np.int32],
    seams: NDArray[np.bool_],
    settings: Settings,
) -> list[MeasuredDent]:
    """Steps where two panels' contours stand apart along their seam."""
    steps = []
    kernel = np.ones((3, 3), np.uint8)
    for first, one in enumerate(panels):
        near = cv2.dilate(one.mask.astype(np.uint8), kernel) > 0
        for other in panels[first + 1 :]:
            at = near & other.mask
            if at.sum() * max(lattice.spacing) < settings.smallest_width:
                continue
            points = lattice.points[at]
            apart = one.contour.deviation(points)[2] - other.contour.deviation(points)[2]
            height = float(np.median(np.abs(apart)))
            spread = 1.4826 * float(np.median(np.abs(np.abs(apart) - height)))
            if height >= max(settings.smallest_depth, SIGNIFICANT * spread):
                steps.append(_step(one, points, apart, height, spread))
    return steps


def _step(panel: Panel, points, apart, height: float, spread: float) -> MeasuredDent:
    x, y, _ = (values.astype(float) for values in panel.contour.local(points))
    centre = np.array([x.mean(), y.mean()])
    _, axes = np.linalg.eigh(np.cov(np.stack([x, y])) + 1e-12 * np.eye(2))
    along = axes[:, 1]
    place = (np.stack([x, y], axis=1) - centre) @ along
    length = float(np.ptp(place))
    order = np.argsort(place)
    outline = panel.contour.point(x[order], y[order])
    direction = along[0] * panel.contour.axes[0] + along[1] * panel.contour.axes[1]
    profile = np.stack([place[order], np.abs(apart)[order]], axis=1)
    return MeasuredDent(
        kind='step',
        position=panel.contour.point(centre[:1], centre[1:])[0],
        normal=panel.contour.normal(centre[:1], centre[1:])[0],
        axis=direction,
        depth=Estimate(height, spread),
        length=Estimate(length, panel.contour.scale / 100),
        width=_NAN,
        model_length=_NAN,
        model_width=_NAN,
        orientation=_NAN,
        area=_NAN,
        volume=_NAN,
        bottom_radius=math.nan,
        significance=height / max(spread, 1e-9),
        is_cut=True,
        outline=outline,
        length_profile=profile,
        width_profile=np.zeros((0, 2)),
    )
