"""The skin that a flight's clouds make against itself: how well they lie on each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.demonstration.appraisal import clouds_of, map_error, mean_absolute
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.simulation.world import World
from ftp_dent_ros.survey.surveying import Joined

# Every so many points each way: of those that are compared, and of those that are put onto the
# true ones, some hundred a cloud.
_EVERY, _FITTED = 3, 30
_MM = 1e3


@dataclass(frozen=True)
class SkinAppraisal:
    """Figures of the skin that the clouds make by the survey's poses.

    Attributes
    ----------
    skin_mae_mm, skin_mae_worst_mm : float
        Mean distance of the clouds' points to the true skin, which each part is put onto as one:
        over all clouds, and of the worst cloud.
    skin_place_mm : float
        Root mean square of how far points lie from their true places then, mostly along the skin.
    skin_off_mm : float
        How far the whole is off in the map, by the autopilot: root mean square.
    skin_parts : int
        In how many parts it is, that share nothing.
    skin_pairs_left_out : int
        Of the pairs of clouds, those that contradict the others.
    """

    skin_mae_mm: float
    skin_mae_worst_mm: float
    skin_place_mm: float
    skin_off_mm: float
    skin_parts: int
    skin_pairs_left_out: int


@dataclass(frozen=True, eq=False)
class Onto:
    """The moves that put each part of a survey onto the true skin, by the stamps of its clouds."""

    moves: Mapping[int, Pose]
    places: NDArray[np.float64]
    offsets: NDArray[np.float64]

    def move(self, stamp_ns: int | None) -> Pose:
        """Of the part that a cloud belongs to; none where it is in no part."""
        none = Pose(Rotation.identity(), np.zeros(3))
        return none if stamp_ns is None else self.moves.get(stamp_ns, none)


def onto_truth(bag: Bag, joined: Joined, world: World) -> Onto:
    """Put each part of a survey as one onto its true place."""
    parts: dict[int, list[tuple[int, NDArray, NDArray]]] = {}
    groups = joined.joining.graph.groups()
    for stamp, cloud in clouds_of(bag, '/points'):
        number = joined.numbers.get(stamp)
        if number is not None:
            few = cloud.points[::_FITTED, ::_FITTED].astype(float)
            few = few[np.isfinite(few).all(axis=-1)]
            found, true = joined.poses[number].apply(few), world.camera_pose(stamp).apply(few)
            parts.setdefault(groups[number], []).append((stamp, found, true))
    moves: dict[int, Pose] = {}
    places, offsets = [], []
    for part in parts.values():
        found, true = (np.concatenate([each[i] for each in part]) for i in (1, 2))
        middle, there = found.mean(axis=0), true.mean(axis=0)
        turn, _ = Rotation.align_vectors(true - there, found - middle)
        move = Pose(turn, there - turn.apply(middle))
        moves |= {stamp: move for stamp, *_ in part}
        places.append(move.apply(found) - true)
        offsets.append(found - true)
    return Onto(moves, np.concatenate(places), np.concatenate(offsets))


def appraise_skin(
    bag: Bag,
    joined: Joined,
    world: World,
    onto: Onto,
    progress: Callable[[], Any] = lambda: None,
) -> SkinAppraisal:
    """Compare the skin that a bag's clouds make with the true one.

    Parameters
    ----------
    bag : Bag
    joined : Joined
        Its clouds.
    world : World
        In which it was recorded.
    onto : Onto
        From `onto_truth`.
    progress : callable
        Called after each cloud.
    """
    errors = []
    for stamp, cloud in clouds_of(bag, '/points'):
        number = joined.numbers.get(stamp)
        if number is not None:
            placed = cloud.transformed(onto.move(stamp) @ joined.poses[number])
            errors.append(mean_absolute(map_error(world, placed, _EVERY)))
        progress()
    return SkinAppraisal(
        skin_mae_mm=float(np.mean(errors)),
        skin_mae_worst_mm=max(errors),
        skin_place_mm=_rms(onto.places) * _MM,
        skin_off_mm=_rms(onto.offsets) * _MM,
        skin_parts=len({id(move) for move in onto.moves.values()}),
        skin_pairs_left_out=len(joined.joining.graph.left_out),
    )


def _rms(offsets: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.square(offsets).sum(axis=-1).mean()))
