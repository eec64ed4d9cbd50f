"""Clouds of a joined skin as they are inspected: each in its place, with what all tell of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from ftp_dent_ros.inspection.dent import Estimate, Inspection, MeasuredDent
from ftp_dent_ros.recording.clouds import BagCloud, bag_clouds
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.survey.joined import Joined


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
