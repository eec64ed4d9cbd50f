"""One cloud to its dents: the algorithm, one line a step."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.inspection.baring import bare_skin
from ftp_dent_ros.inspection.contour import Contour
from ftp_dent_ros.inspection.dent import Inspection, MeasuredDent
from ftp_dent_ros.inspection.detection import SIGNIFICANT, Candidate, find_candidates
from ftp_dent_ros.inspection.lattice import Lattice
from ftp_dent_ros.inspection.measurement import Surroundings, least_depth, measure
from ftp_dent_ros.inspection.noise import Noise
from ftp_dent_ros.inspection.panels import find_panels, seam
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.steps import find_steps

# Cells beside a border of two panels where the reconstruction blurs one into the other.
_SEAM = 3
# Of a candidate's window, as a part of its size.
_MARGIN = 0.45
# Points along the longer side of a candidate's window, about.
_WINDOW = 110


def inspect(
    cloud: Cloud,
    noise: NDArray | None = None,
    settings: Settings | None = None,
    viewpoint: ArrayLike = (0, 0, 0),
) -> Inspection:
    """Find and measure the dents in a cloud.

    Parameters
    ----------
    cloud : Cloud
        Organised, in any frame, metres.
    noise : ndarray, shape (rows, columns), optional
        Standard deviation of each point along its ray, metres, as the reconstruction predicts
        it; without it, it is estimated from the cloud.
    settings : Settings, optional
    viewpoint : array_like, shape (3,)
        Of the camera in the cloud's frame, on the outer side of the skin.

    Raises
    ------
    CloudError
        The cloud cannot be inspected; the message says why.
    """
    settings = settings or Settings()
    lattice = Lattice.of(cloud, noise, settings)
    panels, labels = find_panels(lattice, np.asarray(viewpoint, float) - lattice.origin, settings)
    if not panels:
        raise CloudError(
            'no part of the cloud is large enough to know the skin: come closer, or light more'
        )
    seams = seam(labels, _SEAM)
    found: list[MeasuredDent] = find_steps(lattice, panels, labels, seams, settings)
    shape = cloud.points.shape[:2]
    fine = lattice.spread(labels, shape)
    deviation = np.full(shape, np.nan, np.float32)
    spread = np.full(shape, np.nan, np.float32)
    for index, panel in enumerate(panels):
        contour, chance, maps = bare_skin(lattice, panel, seams, settings)
        at = lattice.measured & (fine == index)
        np.copyto(deviation, contour.depth(lattice.all_points), where=at)
        np.copyto(spread, lattice.spread(chance.after(0), shape), where=at)
        inner = panel.mask & ~seams
        for candidate in find_candidates(maps, chance, inner, settings):
            around = _surroundings(candidate, at, lattice, contour, chance, seams)
            if around is None:
                continue
            area = candidate.mask.sum() * lattice.spacing[0] * lattice.spacing[1]
            dents = measure(candidate, around, contour, chance, area, settings)
            found += [dent for dent in dents if _is_reported(dent, settings)]
    moved = [_moved(dent, lattice.origin) for dent in found]
    dents = sorted((d for d in moved if d.kind == 'dent'), key=lambda d: -d.depth.value)
    others = tuple(dent for dent in moved if dent.kind != 'dent')
    return Inspection(_with_clearance(dents), others, deviation, spread)


def _surroundings(
    candidate: Candidate,
    at: NDArray[np.bool_],
    lattice: Lattice,
    contour: Contour,
    noise: Noise,
    seams: NDArray[np.bool_],
) -> Surroundings | None:
    """Points around a candidate; none if it is smaller than anything to report."""
    rows, columns = np.nonzero(candidate.mask)
    extent = candidate.mask[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    bulk = cv2.erode(
        extent.astype(np.uint8),
        np.ones((3, 3), np.uint8),
        borderType=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    if not np.any(bulk):
        # Two cells wide: narrower than half of the smallest dent.
        return None
    margin = int(_MARGIN * max(np.ptp(rows), np.ptp(columns))) + 5
    block = lattice.block
    top, left = max(rows.min() - margin, 0), max(columns.min() - margin, 0)
    bottom, right = rows.max() + margin + 1, columns.max() + margin + 1
    window = slice(top * block, bottom * block), slice(left * block, right * block)
    usable = at[window]
    if seams.any():
        usable = usable & ~lattice.spread(seams, at.shape)[window]
    points = lattice.all_points[window]
    every = max(1, max(usable.shape) // _WINDOW)
    if every > 1:
        size = usable.shape[1] // every, usable.shape[0] // every
        kept = cv2.copyTo(points, usable.astype(np.uint8))
        mean = cv2.resize(kept, size, interpolation=cv2.INTER_AREA)
        share = cv2.resize(usable.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        usable = share > 0.5
        values = mean[usable] / share[usable][:, None]
    else:
        values = points[usable]
    if len(values) < 30:
        return None
    x, y, depth = (axis.astype(float) for axis in contour.deviation(values))
    cells = lattice.points[candidate.mask]
    around_x, around_y, _ = contour.local(cells)
    at_peak = lattice.points[candidate.peaks[:, 0], candidate.peaks[:, 1]]
    peak_x, peak_y, _ = contour.local(at_peak)
    pad = 0.35 * max(np.ptp(around_x), np.ptp(around_y)) + 4 * max(lattice.spacing)
    bounds = (
        float(around_x.min() - pad),
        float(around_x.max() + pad),
        float(around_y.min() - pad),
        float(around_y.max() + pad),
    )
    spacing = every * max(lattice.spacing) / block
    local = float(np.median(noise.extra[candidate.mask]))
    peaks = np.stack([peak_x, peak_y], axis=1).astype(float)
    return Surroundings(x, y, depth, peaks, spacing, bounds, local)


def _is_reported(dent: MeasuredDent, settings: Settings) -> bool:
    length, width = dent.length.value, dent.width.value
    return (
        abs(dent.depth.value) >= least_depth(dent.is_cut, length, width, settings)
        and width >= settings.smallest_width
        and dent.significance >= SIGNIFICANT
        and abs(dent.depth.value) >= SIGNIFICANT * dent.depth.uncertainty
    )


def _moved(dent: MeasuredDent, origin: NDArray[np.float64]) -> MeasuredDent:
    return replace(dent, position=dent.position + origin, outline=dent.outline + origin)


def _with_clearance(dents: list[MeasuredDent]) -> tuple[MeasuredDent, ...]:
    """The dents with the distance between their outlines."""
    result = []
    for dent in dents:
        nearest = math.inf
        for other in dents:
            if other is not dent:
                apart = dent.outline[::4, None] - other.outline[None, ::4]
                nearest = min(nearest, float(np.linalg.norm(apart, axis=-1).min()))
        result.append(replace(dent, clearance=nearest))
    return tuple(result)
