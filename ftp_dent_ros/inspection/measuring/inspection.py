"""One cloud to its dents: the algorithm, one line a step."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import (
    Inspection,
    MeasuredDent,
    SmallestDent,
    Waviness,
    with_clearances,
)
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.inspection.measuring.detection import find_places
from ftp_dent_ros.inspection.measuring.findable import findable_depth
from ftp_dent_ros.inspection.measuring.lattice import Lattice
from ftp_dent_ros.inspection.measuring.measurement import measure
from ftp_dent_ros.inspection.measuring.segmentation import Segment, seams, segment
from ftp_dent_ros.inspection.measuring.skin import Skin, bare_skin
from ftp_dent_ros.inspection.measuring.steps import find_steps
from ftp_dent_ros.inspection.measuring.waviness import CUTOFF, waviness_of

_SHAPE = "may be the skin's own shape, which no simple contour meets"
# Cells beside a border of two skins where the reconstruction blurs one into the other.
_SEAM = 3


def inspect(
    cloud: Cloud,
    settings: SmallestDent | None = None,
    viewpoint: ArrayLike = (0, 0, 0),
) -> Inspection:
    """Find and measure the dents in a cloud.

    Parameters
    ----------
    cloud : Cloud
        Organised, in any frame, metres. Dents are looked for in the points as they were before
        they were denoised, and measured there, where the cloud has them. What it states of its
        points' uncertainty and resolution is used; without it, noise is estimated.
    settings : SmallestDent, optional
    viewpoint : array_like, shape (3,)
        Of the camera in the cloud's frame, on the outer side of the skin.

    Raises
    ------
    CloudError
        The cloud cannot be inspected; the message says why.
    """
    settings = settings or SmallestDent()
    seen_from = np.asarray(viewpoint, float)
    lattice = Lattice.of(cloud, settings, seen_from)
    segments, labels = segment(lattice, seen_from - lattice.origin, settings)
    if not segments:
        raise CloudError(
            'no part of the cloud is large enough to know the skin: come closer, or light more'
        )
    borders = seams(labels, _SEAM)
    found: list[MeasuredDent] = find_steps(lattice, segments, borders, settings)
    wavy: list[Waviness] = []
    shape = cloud.points.shape[:2]
    deviation, noise, findable = (np.full(shape, np.nan, np.float32) for _ in range(3))
    fine = lattice.spread(labels, shape)
    shown = lattice.relative(cloud.points)
    # A segment that lies within another one has no cells left.
    for index in np.unique(labels[labels >= 0]):
        part = segments[index]
        skin = bare_skin(lattice, part, borders, settings)
        at = lattice.measured & (fine == index)
        depth = skin.contour.depth(shown)
        if skin.relief is not None:
            depth = depth - lattice.spread(skin.relief.heights, shape, cv2.INTER_CUBIC)
            wavy.append(waviness_of(skin.relief, part.mask, lattice))
        np.copyto(deviation, depth, where=at)
        strays = lattice.spread(skin.noise.after(0), shape)
        np.copyto(noise, np.where(np.isfinite(cloud.sigma), cloud.sigma, strays), where=at)
        least = findable_depth(skin, lattice, settings)
        np.copyto(findable, lattice.spread(least, shape), where=at)
        for place in find_places(skin, lattice, settings):
            dents = measure(place, skin, lattice, settings)
            found += [_unless_shape(dent, part, skin, settings) for dent in dents]
    placed = with_clearances([_moved(dent, lattice.origin) for dent in found])
    dents = sorted((d for d in placed if d.kind == 'dent'), key=lambda d: -d.depth.value)
    others = tuple(dent for dent in placed if dent.kind != 'dent')
    return Inspection(tuple(dents), others, tuple(wavy), deviation, noise, findable)


def _unless_shape(
    dent: MeasuredDent, part: Segment, skin: Skin, settings: SmallestDent
) -> MeasuredDent:
    """A dent; in doubt where it is as long as waves are on a skin that no contour meets.

    What a relief explains is known within it, but not beyond the rim.
    """
    is_known = part.is_met or (skin.relief is not None and not dent.is_cut)
    if is_known or dent.length.value < CUTOFF * settings.smallest_width:
        return dent
    return replace(dent, kind='other', reason=_SHAPE)


def _moved(dent: MeasuredDent, origin: np.ndarray) -> MeasuredDent:
    return replace(dent, position=dent.position + origin, outline=dent.outline + origin)
