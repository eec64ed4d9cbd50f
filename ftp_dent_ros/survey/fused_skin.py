"""Clouds of a joined skin as they are inspected: each in its place, with what all tell of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ftp_dent_ros.inspection.dent import Estimate, Inspection, MeasuredDent
from ftp_dent_ros.recording.clouds import BagCloud, bag_clouds
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.survey.joined import Joined
from ftp_dent_ros.survey.result import Relief
from ftp_dent_ros.survey.skin_map.fusion import PIXEL

# Of the skin that is kept about a dent: times the dent's own sizes, metres beside them, and points
# across, at most.
_BEYOND, _BESIDE, _POINTS = 1.5, 0.006, 80


class FusedSkin:
    """What all clouds of some bags tell together, and the picture that they make.

    Parameters
    ----------
    bags : sequence of Bag
    joined : Joined
        Their clouds.
    progress : callable
        Called after each cloud.
    """

    def __init__(
        self, bags: Sequence[Bag], joined: Joined, progress: Callable[[], Any] = lambda: None
    ) -> None:
        self._bags, self._joined = bags, joined
        self.mosaic, self._fusion = joined.mosaic(), joined.fusion()
        for item in self.clouds():
            self._fusion.add(item.cloud, joined.poses[joined.numbers[item.stamp_ns]])
            progress()

    def clouds(self) -> Iterator[BagCloud]:
        """The clouds that were joined, each the first time that it comes."""
        known = set(self._joined.numbers)
        for bag in self._bags:
            for item in bag_clouds(bag, photographs=False):
                if item.stamp_ns in known:
                    known.discard(item.stamp_ns)
                    yield item

    def prepared(self, item: BagCloud) -> BagCloud:
        """A cloud in its place as seen from the middle one, its points those of all clouds.

        One that was not joined is as it was.
        """
        number = self._joined.numbers.get(item.stamp_ns)
        if number is None:
            return item
        pose = self._joined.poses[number]
        return replace(
            item,
            cloud=self._fusion.fused(item.cloud, pose),
            pose=pose,
            vehicle=pose,
            covariance=self._joined.covariances_among_them[number],
        )

    def relief(self, dent: MeasuredDent) -> Relief | None:
        """The skin about a dent; None where its sizes are not known."""
        if dent.is_cut or not (dent.length.is_measured and dent.width.is_measured):
            return None
        halves = np.array([dent.length.value, dent.width.value]) / 2 * _BEYOND + _BESIDE
        spacing = max(PIXEL, 2 * float(halves.max()) / _POINTS)
        columns, rows = np.ceil(halves / spacing).astype(int)
        empty = np.full((2 * rows + 1, 2 * columns + 1), np.nan, np.float32)
        a, b = Relief(spacing, empty).places()
        across = np.cross(dent.normal, dent.axis)
        plane = dent.position + a[..., None] * dent.axis + b[..., None] * across
        heights = (self._fusion.heights(plane) - dent.position) @ dent.normal
        return Relief(spacing, heights.astype(np.float32))

    def shown(self, item: BagCloud, found: Inspection | None) -> None:
        """Draw a prepared cloud into the picture, with what its inspection tells."""
        number = self._joined.numbers.get(item.stamp_ns)
        if number is not None:
            self.mosaic.add(number, item.cloud, self._joined.poses[number], item.skin, found)

    def told(self, item: BagCloud, found: Inspection) -> Inspection:
        """What is told of a prepared cloud: depths as uncertain as what all clouds may share."""
        if item.pose is None or item.stamp_ns not in self._joined.numbers:
            return found
        pose, shared = item.pose, self._fusion.shared
        dents, others = (
            tuple(_with_shared(each, shared(pose.apply(each.position))) for each in part)
            for part in (found.dents, found.others)
        )
        return replace(found, dents=dents, others=others)


def _with_shared(dent: MeasuredDent, shared: float) -> MeasuredDent:
    """The same dent, its depth and volume as uncertain as what all its clouds may share."""
    part = shared / abs(dent.depth.value)
    depth, volume = (
        Estimate(each.value, math.hypot(each.uncertainty, part * each.value))
        for each in (dent.depth, dent.volume)
    )
    return replace(dent, depth=depth, volume=volume)
