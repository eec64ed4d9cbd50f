"""The skins in a cloud: where position leaps, one ends and another begins."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.contour import Contour, fit_contour
from ftp_dent_ros.inspection.measuring.gaps import gaps_of
from ftp_dent_ros.inspection.measuring.lattice import ENOUGH, LEAST, LEVEL, TOGETHER, WIDE, Lattice
from ftp_dent_ros.inspection.measuring.noise import (
    SURE,
    Map,
    Mask,
    median_of,
    rough_noise,
    smoother,
)
from ftp_dent_ros.robust import fitted

# Part of a skin, or of its rim, that strays before no contour explains it: dents are fewer.
_STRAYS = 0.3
# Part of its height that the border of another skin rises by within a cell's neighbours: half of
# what the rim cuts, and all but a twentieth of what lies whole on a skin, as dents do.
_HALF, _WHOLE = (0.55, 0.5), (0.85, 0.05)
# Two parts are one skin if about one contour they stray no more than so many times as about their
# own, and do not stand apart beside what parts them.
_STRAY = 1.25
# Slope within which islands in a gap are of the skin around it.
_SLOPE = 0.5

_NEAR = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class Segment:
    """Cells of a lattice that share an undeformed contour.

    Attributes
    ----------
    mask : ndarray, shape (rows, columns), bool
    contour : Contour
        Relative to the lattice's origin.
    tolerance : float
        Deviation within which cells agree with the contour, metres.
    is_met : bool
        Whether most of the skin, or of its rim, agrees with the contour: else what departs from
        it may be the skin's own shape.
    """

    mask: Mask
    contour: Contour
    tolerance: float
    is_met: bool = True


def segment(
    lattice: Lattice, viewpoint: NDArray[np.float64], settings: SmallestDent
) -> tuple[list[Segment], NDArray[np.int32]]:
    """Split the lattice into skins, each with its contour.

    What is not measured, as a strip under a shadow's edge, parts no skin if one contour explains
    both sides of it.

    Parameters
    ----------
    lattice : Lattice
    viewpoint : ndarray, shape (3,)
        Relative to the lattice's origin.
    settings : SmallestDent

    Returns
    -------
    segments : list of Segment
    labels : ndarray, shape (rows, columns), int32
        Index of each cell's segment; -1 where there is none.
    """
    split = _Split(lattice, viewpoint, settings)
    labels = np.full(lattice.valid.shape, -1, np.int32)
    found: list[Segment] = []
    whole = lattice.valid & ~_jumps(lattice)
    for region in split.joined(_parts(whole, split.least)):
        parts = split.skins_of(region)
        marks = np.full(region.shape, -1, np.int32)
        for index, part in enumerate(parts, len(found)):
            marks[part.mask] = index
        labels[region] = _nearest(marks)[region]
        found += parts
    labels = split.with_islands(found, whole, labels)
    return [replace(each, mask=labels == k) for k, each in enumerate(found)], labels


def seams(labels: NDArray[np.int32], cells: int) -> Mask:
    """Cells within some cells of the border between two segments."""
    highest = cv2.dilate(labels.astype(np.float32), _NEAR)
    lowest = cv2.erode(np.where(labels < 0, np.inf, labels).astype(np.float32), _NEAR)
    return _grown((highest > lowest) & (labels >= 0), cells)


class _Split:
    """How a lattice is split: what its parts have in common."""

    def __init__(
        self, lattice: Lattice, viewpoint: NDArray[np.float64], settings: SmallestDent
    ) -> None:
        self._lattice, self._viewpoint, self._settings = lattice, viewpoint, settings
        self._rng = np.random.default_rng(0)
        cells = settings.smallest_width**2 / (lattice.spacing[0] * lattice.spacing[1])
        self.least = WIDE**2 * cells
        self._finest = LEVEL * settings.smallest_depth

    def _depths(self, part: Mask, noise: float) -> tuple[Contour, Map]:
        """Contour of a part, and how deep its cells lie below it; 0 elsewhere."""
        cells = np.flatnonzero(part)
        points = self._lattice.points.reshape(-1, 3)[cells[:: 1 + len(cells) // ENOUGH]]
        contour = fit_contour(points, self._viewpoint, noise, self._rng)
        return contour, np.where(part, contour.depth(self._lattice.points), np.float32(0))

    def joined(self, regions: list[Mask]) -> list[Mask]:
        """The regions, those that go on beyond what was not measured as one."""
        whole: list[Mask] = []
        for region in regions:
            for index, other in enumerate(whole):
                if self._is_one(region, other):
                    whole[index] = other | region
                    break
            else:
                whole.append(region)
        return whole

    def _is_one(self, one: Mask, other: Mask) -> bool:
        """Whether one contour explains two regions as well as one each does."""
        _, together = self._depths(one | other, self._finest)
        for part in (one, other):
            _, alone = self._depths(part, self._finest)
            strays = median_of(np.abs(together[part]))
            if strays > max(_STRAY * median_of(np.abs(alone[part])), self._finest):
                return False
        reach = WIDE * self._settings.smallest_width / max(self._lattice.spacing)
        reach += float(_distance(one)[other].min())
        sides = one & (_distance(other) < reach), other & (_distance(one) < reach)
        high, low = (median_of(together[side]) for side in sides)
        return abs(high - low) < LEAST * self._settings.smallest_depth

    def skins_of(self, region: Mask) -> list[Segment]:
        """Skins within one region: laps and steps have no gap."""
        found: list[Segment] = []
        queue = [region]
        while queue:
            part = queue.pop(0)
            contour, deviation = self._depths(part, self._finest)
            noise = max(rough_noise(deviation, part), self._finest / 2)
            if noise > self._finest:
                contour, deviation = self._depths(part, noise)
            tolerance = SURE * max(noise, self._finest)
            smooth = np.nan_to_num(smoother(part, (1.0, 1.0))(deviation))
            left = part.copy()
            for rest in _parts(part & (np.abs(smooth) > tolerance), self.least):
                core = self._another(rest, deviation, part, tolerance)
                if core is not None:
                    queue.append(core)
                    left &= ~rest
            off = left & (np.abs(deviation) > tolerance)
            rim = left & ~_eroded(left, 2)
            strays = min(np.mean(off[left]), np.mean(off[rim])) if left.any() else 0.0
            found.append(Segment(left, contour, tolerance, bool(strays < _STRAYS)))
        return found

    def _another(self, rest: Mask, deviation: Map, part: Mask, tolerance: float) -> Mask | None:
        """Cells of what departs from a contour that are another skin: it steps, and is flat."""
        core = _eroded(rest, 2)
        if not _eroded(core, 2).any():
            return None
        outside = _grown(~part, 1) | _frame(part.shape)
        least, share = _HALF if (rest & outside).any() else _WHOLE
        resolution = self._lattice.resolution
        wide = 0.0 if resolution is None else median_of(resolution[rest])
        reach = max(1, round(wide / 4 / max(self._lattice.spacing)))
        size = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
        rise = cv2.dilate(deviation, size) - cv2.erode(deviation, size)
        measured = _eroded(part, reach)
        steepest = cv2.dilate(np.where(measured, rise, np.float32(0)), np.ones((7, 7), np.uint8))
        border = _grown(rest, 1) & ~rest & measured
        height = median_of(np.abs(deviation[core]))
        # Noise that is not negligible rises by itself.
        wanted = least * height + tolerance - SURE * self._finest
        if border.any() and np.quantile(steepest[border], share) < wanted:
            return None
        # On most of it one plane lies beside the contour but for noise: crests are round.
        rows, columns = np.nonzero(core)
        terms = np.stack([np.ones(len(rows)), rows, columns]).astype(float)
        left = np.abs(deviation[core] - fitted(terms, deviation[core]) @ terms)
        if np.median(left) > max(tolerance / SURE, height / 10):
            return None
        agreed = np.zeros_like(core)
        agreed[core] = left < 3 * max(tolerance, height / 10)
        return agreed

    def with_islands(
        self, found: list[Segment], whole: Mask, labels: NDArray[np.int32]
    ) -> NDArray[np.int32]:
        """Labels, with what lies within a skin given to it: bottoms of dents, islands in gaps.

        A dent may be as deep as another skin lies, and its bottom agree with that one's contour.
        """
        spacing, reach = max(self._lattice.spacing), WIDE * self._settings.smallest_width
        for index, each in enumerate(found):
            within = gaps_of(labels == index, round(reach / spacing)) & whole
            if not within.any():
                continue
            own = within | (labels == index)
            deviation = np.where(own, each.contour.depth(self._lattice.points), np.float32(0))
            near = np.abs(deviation) < each.tolerance + _SLOPE * spacing * _distance(~within)
            for part in _parts(within & (labels >= 0), 1):
                if self._another(part, deviation, own, each.tolerance) is None:
                    labels[part] = index
            labels[within & (labels < 0) & near] = index
        return labels


def _jumps(lattice: Lattice) -> Mask:
    """Cells before a jump to the next one."""
    cut = np.zeros(lattice.valid.shape, bool)
    limit = TOGETHER * max(lattice.spacing)
    for axis, there in ((0, np.s_[1:]), (1, np.s_[:, 1:])):
        square = sum(map(np.square, cv2.split(np.diff(lattice.points, axis=axis))))
        cut[there] |= (square > limit**2) & lattice.valid[there]
    return cut


def _parts(mask: Mask, least: float) -> list[Mask]:
    """Connected parts (4 neighbours) of at least so many cells, the largest first."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    order = np.argsort(-areas, kind='stable')
    return [labels == index + 1 for index in order if areas[index] >= least]


def _nearest(marks: NDArray[np.int32]) -> NDArray[np.int32]:
    """The mark of the nearest cell that has one, not less than 0, shape (rows, columns)."""
    _, labels = cv2.distanceTransformWithLabels(
        (marks < 0).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.full(labels.max() + 1, -1, np.int32)
    table[labels[marks >= 0]] = marks[marks >= 0]
    return table[labels]


def _distance(mask: Mask) -> Map:
    """Of each cell to the nearest of a mask, cells."""
    return np.asarray(cv2.distanceTransform((~mask).view(np.uint8), cv2.DIST_L2, 3))


def _grown(mask: Mask, cells: int) -> Mask:
    size = 2 * cells + 1
    return cv2.dilate(mask.view(np.uint8), np.ones((size, size), np.uint8)) > 0


def _eroded(mask: Mask, cells: int) -> Mask:
    size = 2 * cells + 1
    return cv2.erode(mask.view(np.uint8), np.ones((size, size), np.uint8), borderValue=0) > 0


def _frame(shape: tuple[int, ...]) -> Mask:
    frame = np.ones(shape, bool)
    frame[1:-1, 1:-1] = False
    return frame
