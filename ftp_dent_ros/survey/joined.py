"""All clouds of some bags, joined to one skin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import BagError, CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.clouds import bag_clouds
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.survey.poses.joining import Joining
from ftp_dent_ros.survey.skin_map.fusion import Fusion
from ftp_dent_ros.survey.skin_map.mosaic import Mosaic
from ftp_dent_ros.survey.skin_map.unrolling import Unrolled

# Of a pose that says nothing of its accuracy: metres, radians; more than the dent list takes.
_UNKNOWN = np.diag([0.03**2] * 3 + [0.015**2] * 3)
# Frame of a survey that no autopilot has placed.
_OWN_FRAME = 'survey'
# Parts of a skin whose sizes a sentence names.
_SIZES = 8


@dataclass(frozen=True, eq=False)
class Joined:
    """Clouds, and where their cameras were.

    Attributes
    ----------
    joining : Joining
    frame_id : str
        Of the poses.
    remarks : tuple of str
        What could not be used, and why; what was assumed.
    """

    joining: Joining
    frame_id: str
    remarks: tuple[str, ...]

    @property
    def poses(self) -> Sequence[Pose]:
        """Of the camera at each cloud."""
        return self.joining.graph.poses

    @cached_property
    def numbers(self) -> dict[int, int]:
        """Number of each cloud, from 0, by its stamp (ns)."""
        return {stamp: number for number, stamp in enumerate(self.joining.stamps_ns)}

    @cached_property
    def covariances(self) -> NDArray[np.float64]:
        """Of the poses in the map, shape (n, 6, 6), as in geometry_msgs/PoseWithCovariance."""
        return self.joining.graph.covariances()

    @cached_property
    def covariances_among_them(self) -> NDArray[np.float64]:
        """The same as seen from the middle cloud."""
        return self.joining.graph.covariances(anchor=len(self.poses) // 2)

    def mosaic(self) -> Mosaic:
        """A mosaic that has room for all clouds."""
        return Mosaic(*_skin(self.joining))

    def fusion(self) -> Fusion:
        """What all clouds tell together, with room for all and none in it yet."""
        return Fusion(*_skin(self.joining))


def join_bags(
    bags: Sequence[Bag],
    progress: Callable[[], Any] = lambda: None,
    remark: Callable[[str], Any] = lambda text: None,
) -> Joined:
    """Join all clouds of all bags, which show one aircraft.

    Parameters
    ----------
    bags : sequence of Bag
    progress : callable
        Called after each cloud.
    remark : callable
        Called with each remark as it comes up.

    Raises
    ------
    BagError
        A bag has no clouds in the camera's frame, or poses in another map than the others.
    CloudError
        No cloud can be used, or nothing tells where a bag's skin lies.
    """
    remarks: list[str] = []

    def say(text: str) -> None:
        remarks.append(text)
        remark(text)

    joining = Joining(say)
    frame_id, known = '', set[int]()
    unplaced = without_covariance = 0
    for flight, bag in enumerate(bags):
        for item in bag_clouds(bag, lambda skipped: say(str(skipped)), False):
            if not item.in_camera:
                raise BagError(
                    f'{bag.path}: has its clouds in {item.frame_id} alone: record /points too'
                )
            if item.stamp_ns in known:
                continue
            known.add(item.stamp_ns)
            if item.pose is not None:
                if frame_id not in ('', item.frame_id):
                    raise BagError(
                        f'{bag.path}: its poses are in {item.frame_id!r}, those before in '
                        f'{frame_id!r}: survey them one by one'
                    )
                frame_id = item.frame_id
            covariance = item.covariance
            if item.pose is not None and (covariance is None or not np.any(covariance)):
                covariance, without_covariance = _UNKNOWN, without_covariance + 1
            unplaced += item.pose is None
            try:
                joining.add(item.stamp_ns, item.cloud, item.skin, item.pose, covariance, flight)
            except CloudError as reason:
                say(f'cloud at {item.stamp_ns / 1e9:.3f} s: {reason}')
            progress()
    if not joining.stamps_ns:
        raise CloudError(f'{bags[0].path}: no cloud in it can be used: check the clouds')
    joining.finish()
    _require_ties(joining, bags)
    clouds = len(joining.stamps_ns)
    if unplaced:
        say(
            f'{unplaced} of {clouds} clouds have no pose: they are placed by what they share with '
            'the others alone' + ('' if frame_id else ', in a frame of their own')
        )
    if without_covariance:
        say(f'{without_covariance} poses do not state how good they are: 30 mm is taken')
    if joining.without_skin:
        else_told = 'the autopilot' if frame_id else 'their shape'
        say(
            f'{joining.without_skin} of {clouds} clouds have no image of the skin: along the skin '
            f'only {else_told} tells where they lie; record /skin too'
        )
    _tell_groups(joining, say)
    return Joined(joining, frame_id or _OWN_FRAME, tuple(remarks))


def _require_ties(joining: Joining, bags: Sequence[Bag]) -> None:
    """Refuse what nothing places: a bag that shares no skin, or clouds by guess alone."""
    nodes = joining.graph.nodes
    parts: dict[int, set[int]] = {}
    for node, group in zip(nodes, joining.graph.groups(), strict=True):
        parts.setdefault(node.flight, set()).add(group)
    placed = {node.flight for node in nodes if node.stated is not None}
    # Without any poses, the first bag's skin is the frame of the others.
    for flight in sorted(parts.keys() - placed)[0 if placed else 1 :]:
        others = set().union(*(parts[each] for each in parts if each != flight))
        if not parts[flight] & others:
            raise CloudError(
                f'{bags[flight].path}: has no poses, and shares no skin with the other bags, so '
                'that nothing tells where it lies: survey it by itself'
            )
    blind = not placed and joining.without_skin == len(nodes)
    if blind and len(set().union(*parts.values())) > 1:
        raise CloudError(
            f'{bags[0].path}: has neither poses nor images of the skin, and its shape alone does '
            'not tell how the clouds lie: record /skin and /tagged/camera_pose too'
        )


def _tell_groups(joining: Joining, say: Callable[[str], Any]) -> None:
    groups: dict[int, list[int]] = {}
    for number, group in enumerate(joining.graph.groups()):
        groups.setdefault(group, []).append(number)
    if len(groups) == 1:
        return
    parts = sorted(groups.values(), key=len, reverse=True)
    sizes = ', '.join(str(len(each)) for each in parts[:_SIZES])
    if len(parts) > _SIZES:
        sizes += ', ...'
    nodes = joining.graph.nodes
    adrift = sum(all(nodes[number].stated is None for number in part) for part in parts)
    told = 'only the autopilot tells how these lie to each other'
    if adrift == len(parts):
        told = 'nothing tells how these lie to each other: they lie there by guess'
    elif adrift:
        told += f', and {adrift} of them have no poses: they lie there by guess'
    say(f'the clouds are not one skin but {len(parts)} parts ({sizes} clouds): {told}')


def _skin(
    joining: Joining,
) -> tuple[Unrolled, NDArray[np.float64], NDArray[np.float64]]:
    """The unrolled skin, and its extent."""
    points = np.concatenate(
        [
            pose.apply(each)
            for pose, each in zip(joining.graph.poses, joining.outlines, strict=True)
        ]
    )
    normals = np.stack(
        [
            pose.rotation.apply(each)
            for pose, each in zip(joining.graph.poses, joining.normals, strict=True)
        ]
    )
    repeated = np.repeat(normals, [len(each) for each in joining.outlines], axis=0)
    skin = Unrolled.through(points, repeated)
    place = skin.place(points)[:, :2]
    room = 0.05
    return skin, place.min(axis=0) - room, place.max(axis=0) + room
