"""One cloud to its dents: the algorithm, one line a step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import (
    Inspection,
    MeasuredDent,
    SmallestDent,
    Waviness,
    with_clearances,
)
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.inspection.measuring.findable import findable_depth
from ftp_dent_ros.inspection.measuring.hidden import hidden_dent
from ftp_dent_ros.inspection.measuring.measurement import measure
from ftp_dent_ros.inspection.measuring.places.bare_skin import bare_skin
from ftp_dent_ros.inspection.measuring.places.detection import find_candidates
from ftp_dent_ros.inspection.measuring.places.steps import find_steps
from ftp_dent_ros.inspection.measuring.places.surroundings import surroundings_of
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.panels import Panel, find_panels, seam
from ftp_dent_ros.inspection.measuring.skin.waviness import CUTOFF, waviness_of

# Cells beside a border of two panels where the reconstruction blurs one into the other.
_SEAM = 3
_SHAPE = "may be the panel's own shape, which no simple contour meets"
# Middles that are nearer than this part of the narrower one's width are one dent's: of two that
# touch they are half a width apart.
_ONE_PLACE = 0.25


def inspect(
    cloud: Cloud,
    settings: SmallestDent | None = None,
    viewpoint: ArrayLike = (0, 0, 0),
) -> Inspection:
    """Find and measure the dents in a cloud.

    Parameters
    ----------
    cloud : Cloud
        Organised, in any frame, metres. What it states of its points' uncertainty and resolution
        is used; without it, noise is estimated from the cloud.
    settings : SmallestDent, optional
    viewpoint : array_like, shape (3,)
        Of the camera in the cloud's frame, on the outer side of the skin.

    Raises
    ------
    CloudError
        The cloud cannot be inspected; the message says why.
    """
    settings = settings or SmallestDent()
    lattice = Lattice.of(cloud, settings)
    panels, labels = find_panels(lattice, np.asarray(viewpoint, float) - lattice.origin, settings)
    if not panels:
        raise CloudError(
            'no part of the cloud is large enough to know the skin: come closer, or light more'
        )
    seams = seam(labels, _SEAM)
    found: list[MeasuredDent] = find_steps(lattice, panels, labels, seams, settings)
    wavy: list[Waviness] = []
    shape = cloud.points.shape[:2]
    fine = lattice.spread(labels, shape)
    deviation = np.full(shape, np.nan, np.float32)
    spread = np.full(shape, np.nan, np.float32)
    findable = np.full(shape, np.nan, np.float32)
    for index, panel in enumerate(panels):
        skin = bare_skin(lattice, panel, seams, settings)
        relief = None if skin.relief is None else skin.relief.at_points(lattice.block, shape)
        at = lattice.measured & (fine == index)
        depth = skin.contour.depth(lattice.all_points)
        np.copyto(deviation, depth if relief is None else depth - relief, where=at)
        np.copyto(spread, lattice.spread(skin.noise.after(0), shape), where=at)
        least = findable_depth(skin, lattice, settings)
        np.copyto(findable, lattice.spread(least, shape), where=at)
        if skin.relief is not None:
            wavy.append(waviness_of(skin.relief, panel.mask, lattice))
        for candidate in find_candidates(skin, panel.mask & ~seams, lattice, settings):
            around = surroundings_of(candidate, at, lattice, skin, relief, seams)
            whole = [] if around is None else measure(candidate, around, skin, settings)
            whole = [_unless_shape(dent, panel, settings) for dent in whole]
            found += whole or hidden_dent(candidate, lattice, skin, settings)
    found = [dent for dent in found if not _is_part(dent, found)]
    placed = with_clearances([_moved(dent, lattice.origin) for dent in found])
    dents = sorted((d for d in placed if d.kind == 'dent'), key=lambda d: -d.depth.value)
    others = tuple(dent for dent in placed if dent.kind != 'dent')
    return Inspection(tuple(dents), others, tuple(wavy), deviation, spread, findable)


def _unless_shape(dent: MeasuredDent, panel: Panel, settings: SmallestDent) -> MeasuredDent:
    """A place, in doubt where it is as long as waves and may be the panel's own shape.

    No contour is met there, or it is one of the fourth degree, which errs at its rim.
    """
    unknown = not panel.is_met or (panel.contour.is_rich and dent.is_cut)
    if not unknown or dent.length.value < CUTOFF * settings.smallest_width:
        return dent
    return replace(dent, kind='other', reason=_SHAPE)


def _is_part(dent: MeasuredDent, found: list[MeasuredDent]) -> bool:
    """Whether something in doubt lies within what is listed as a larger one, or at its place."""
    alike = [
        (other, np.linalg.norm(dent.position - other.position))
        for other in found
        if other is not dent and other.kind != 'other' and other.depth.value * dent.depth.value > 0
        # What is on a plate is no part of the step around it.
        if other.kind != 'step' or other.is_cut
    ]
    if (dent.is_cut or dent.reason) and any(
        # The rim of what is measured may part a dent into rings about one middle.
        apart < _ONE_PLACE * min(other.width.value, dent.width.value)
        and abs(other.depth.value) > abs(dent.depth.value)
        for other, apart in alike
    ):
        return True
    return dent.kind == 'other' and any(
        apart < other.length.value / 2 and other.length.value > dent.length.value
        for other, apart in alike
    )


def _moved(dent: MeasuredDent, origin: NDArray[np.float64]) -> MeasuredDent:
    return replace(dent, position=dent.position + origin, outline=dent.outline + origin)
