"""The cloud's panels, each with its own undeformed contour."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.skin.continuation import depths_of, islands, joined
from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.contour_fit import first_contour, richer_contour
from ftp_dent_ros.inspection.measuring.skin.enclosed import with_enclosed
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import rough_noise, smoothed
from ftp_dent_ros.inspection.measuring.skin.plate import plates
from ftp_dent_ros.inspection.measuring.skin.second_panel import Mask, another_panel, is_stepped

# A neighbour so many spacings away is on another panel.
_JUMP = 4.0
# Side of the smallest panel in smallest widths.
_SMALLEST = 3.0
_SMALLEST_SECOND = 4.0
_MOST = 8
# Cells that a first contour is fitted to some of, about.
_FITTED = 4000
# Part of the rim that a quadric has to miss before a higher degree is tried.
_RIM_OFF = 0.3
# Part of a panel whose contour it is.
_MOST_AGREE = 0.5


@dataclass(frozen=True, eq=False)
class Panel:
    """Cells of a lattice that share an undeformed contour.

    Attributes
    ----------
    mask : ndarray, shape (rows, columns), bool
    contour : Contour
        Relative to the lattice's origin.
    tolerance : float
        Deviation within which cells agree with the contour, metres.
    is_met : bool
        Whether most of the panel or of its rim agrees with the contour: else what departs from it
        may be the panel's own shape.
    """

    mask: Mask
    contour: Contour
    tolerance: float
    is_met: bool = True


def find_panels(
    lattice: Lattice, viewpoint: NDArray[np.float64], settings: SmallestDent
) -> tuple[list[Panel], NDArray[np.int32]]:
    """Split the lattice at jumps and steps, and fit a contour to each part.

    What is not measured, as a strip under a shadow's edge, parts no panel if one contour explains
    both sides of it.

    Parameters
    ----------
    lattice : Lattice
    viewpoint : ndarray, shape (3,)
        Relative to the lattice's origin.
    settings : SmallestDent

    Returns
    -------
    panels : list of Panel
    labels : ndarray, shape (rows, columns), int32
        Index of each cell's panel; -1 where there is none.
    """
    rng = np.random.default_rng(0)
    area = lattice.spacing[0] * lattice.spacing[1]
    least = (_SMALLEST * settings.smallest_width) ** 2 / area
    second = (_SMALLEST_SECOND * settings.smallest_width) ** 2 / area
    seeds: list[Panel] = []
    labels = np.full(lattice.valid.shape, -1, np.int32)
    whole = lattice.valid & ~_jumps(lattice)
    for region in joined(_parts(whole, least), lattice, viewpoint, settings, rng):
        found = _split(lattice, region, viewpoint, settings, least, second, rng)
        marks = np.full(region.shape, -1, np.int32)
        for index, panel in enumerate(found, len(seeds)):
            marks[panel.mask] = index
        labels[region] = (_nearest(marks) if len(found) > 1 else _all(marks, len(seeds)))[region]
        seeds += found
        if len(seeds) >= _MOST:
            break
    for index, seed in enumerate(seeds):
        left = whole & (labels < 0)
        labels[islands(lattice, left, labels == index, seed.contour, seed.tolerance, settings)] = (
            index
        )
    labels = with_enclosed(lattice, [seed.contour for seed in seeds], labels, least)
    panels = [replace(seed, mask=labels == index) for index, seed in enumerate(seeds)]
    return panels, labels


def seam(labels: NDArray[np.int32], cells: int) -> Mask:
    """Cells within some cells of the border between two panels."""
    tops = cv2.dilate(labels.astype(np.float32), np.ones((3, 3), np.uint8))
    marked = np.where(labels < 0, 1e6, labels).astype(np.float32)
    bottoms = cv2.erode(marked, np.ones((3, 3), np.uint8))
    border = ((tops != bottoms) & (bottoms < 1e6) & (labels >= 0)).astype(np.uint8)
    size = 2 * cells + 1
    return cv2.dilate(border, np.ones((size, size), np.uint8)) > 0


def _split(lattice, region, viewpoint, settings, least, second, rng) -> list[Panel]:
    """Panels within one connected region: laps and steps have no gap."""
    panels: list[Panel] = []
    queue = [region]
    while queue and len(panels) < _MOST:
        part = queue.pop(0)
        cells = np.flatnonzero(part)
        points = lattice.points.reshape(-1, 3)[cells[:: 1 + len(cells) // _FITTED]]
        contour = first_contour(points, viewpoint, settings.smallest_depth / 10, rng)
        deviation = depths_of(contour, lattice, part)
        noise = max(rough_noise(deviation, part), settings.smallest_depth / 20)
        if noise > settings.smallest_depth / 8:
            contour = first_contour(points, viewpoint, noise, rng)
            deviation = depths_of(contour, lattice, part)
        tolerance = max(5 * noise, settings.smallest_depth / 2)
        smooth = smoothed(deviation, part, (1.0, 1.0))
        with np.errstate(invalid='ignore'):
            off = part & (np.abs(smooth) > tolerance)
        taken = np.zeros_like(part)
        for rest in _parts(off, second):
            agreed = another_panel(contour, lattice, deviation, rest, part, tolerance)
            if agreed is not None:
                queue.append(agreed)
                taken |= rest
        raised = _parts((smooth < -tolerance) & part & ~taken, least)
        on_it = plates(contour, lattice, deviation, raised, part & ~taken, tolerance)
        for agreed, plate in on_it:
            queue.append(agreed)
            taken |= plate
        if not taken.any():
            contour = _demanded(contour, lattice, deviation, part, tolerance, points, rng)
            deviation = depths_of(contour, lattice, part)
        is_met = taken.any() or _is_met(deviation, part, tolerance, second)
        panels.append(Panel(part & ~taken, contour, tolerance, bool(is_met)))
    return panels


def _demanded(contour, lattice, deviation, part, tolerance, points, rng) -> Contour:
    """The quadric, or a contour of degree 4 if most of the rim demands it.

    Dents lie within: a higher degree that is fitted for their sake would swallow them.
    """
    before = _rim_off(deviation, part, tolerance)
    if before < _RIM_OFF:
        return contour
    richer = richer_contour(contour, points, tolerance / 5, rng)
    after = _rim_off(depths_of(richer, lattice, part), part, tolerance)
    return richer if after < before / 2 else contour


def _is_met(deviation, part, tolerance, least) -> bool:
    """Whether most of a panel agrees with a contour, or what does not lies within it.

    What is stepped is another panel's, whatever the contour.
    """
    if _rim_off(deviation, part, tolerance) < _RIM_OFF:
        return True
    off = part & (np.abs(deviation) > tolerance)
    if off.sum() < _MOST_AGREE * part.sum():
        return True
    kernel = np.ones((5, 5), np.uint8)
    cores = ((rest, cv2.erode(rest.astype(np.uint8), kernel) > 0) for rest in _parts(off, least))
    return any(core.any() and is_stepped(deviation, rest, core, part) for rest, core in cores)


def _rim_off(deviation, part, tolerance) -> float:
    """Part of the rim that deviates."""
    inner = cv2.erode(part.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    strays = np.abs(deviation[part & ~inner]) > tolerance
    return float(strays.mean()) if len(strays) else 0.0


def _jumps(lattice: Lattice) -> Mask:
    """Cells before a jump to the next one."""
    cut = np.zeros(lattice.valid.shape, bool)
    points, valid = lattice.points, lattice.valid
    limit = (_JUMP * max(lattice.spacing)) ** 2
    down = points[1:] - points[:-1]
    cut[1:] |= (np.einsum('ijk,ijk->ij', down, down) > limit) & valid[1:] & valid[:-1]
    right = points[:, 1:] - points[:, :-1]
    far = np.einsum('ijk,ijk->ij', right, right) > limit
    cut[:, 1:] |= far & valid[:, 1:] & valid[:, :-1]
    return cut


def _parts(mask: Mask, least: float) -> list[Mask]:
    """Connected parts (4 neighbours) of at least so many cells, the largest first."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    order = np.argsort(-areas, kind='stable')
    return [labels == index + 1 for index in order if areas[index] >= least]


def _nearest(marks: NDArray[np.int32]) -> NDArray[np.int32]:
    """The mark of the nearest marked cell."""
    free = (marks < 0).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(
        free, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.full(labels.max() + 1, -1, np.int32)
    table[labels[marks >= 0]] = marks[marks >= 0]
    return table[labels]


def _all(marks: NDArray[np.int32], index: int) -> NDArray[np.int32]:
    return np.full_like(marks, index)
