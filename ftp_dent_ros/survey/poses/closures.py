"""Which clouds of other passes a cloud is laid on, so that the passes become one skin."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ftp_dent_ros.survey.patches.folded_patch import Kept
from ftp_dent_ros.survey.poses.pose_graph import PoseGraph

# So many passes, which are others from so many clouds on; and no farther apart than this part of
# both patches' sizes.
_PASSES, _APART, _NEAR = 2, 8, 0.6
# Pairs on the same skin err alike: this part of a patch from the last that was laid on another.
_ANEW = 0.5


def closures(graph: PoseGraph, kept: Mapping[int, Kept], number: int, last: int) -> list[int]:
    """Of other passes that show the same skin, the nearest cloud of each.

    Parameters
    ----------
    graph : PoseGraph
    kept : mapping of int to Kept
        Clouds that can be looked up; `number` is one of them.
    number, last : int
        Of the cloud, and of the last that was laid on another pass; -1 for none.
    """
    others = [each for each in kept if _are_passes(graph, each, number)]
    if not others or _is_same_skin(graph, kept[number], number, last):
        return []
    both = [*others, number]
    seen = np.stack([kept[each].whole.frame.translation for each in both])
    sizes = np.array([kept[each].size for each in both])
    middles = graph.placed(both, seen)
    apart = np.linalg.norm(middles[:-1] - middles[-1], axis=1)
    near = np.flatnonzero(apart < _NEAR * (sizes[:-1] + sizes[-1]))
    chosen: list[int] = []
    for index in near[np.argsort(apart[near], kind='stable')]:
        if all(_are_passes(graph, others[index], each) for each in chosen):
            chosen.append(others[index])
    return chosen[:_PASSES]


def _are_passes(graph: PoseGraph, one: int, other: int) -> bool:
    nodes = graph.nodes
    return abs(one - other) >= _APART or nodes[one].flight != nodes[other].flight


def _is_same_skin(graph: PoseGraph, cloud: Kept, number: int, last: int) -> bool:
    if last < 0 or _are_passes(graph, last, number):
        return False
    apart = np.linalg.norm(graph.poses[last].translation - graph.poses[number].translation)
    return bool(apart < _ANEW * cloud.size)
