"""Pairs of clouds of a flight as they are told, without any clouds."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from flown_skin import STATED, erring
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.information import COMMON, RelativePose, in_common
from ftp_dent_ros.survey.pose_graph import PoseGraph
from ftp_dent_ros.survey.pose_terms import Node

DISTANCE, STEP, APART, HALF_S = 0.8, 0.045, 0.24, 0.5
# Of a pair of neighbours on a skin with rivets and dirt (survey.py); of passes that overlap by a
# third, twice as much.
SIGMA = np.array([3e-5, 2.5e-5, 3e-6, 1.4e-5, 5e-6, 3.3e-5])
PATCH = Pose(Rotation.from_euler('x', np.pi), np.array([0, 0, DISTANCE]))
CENTRE = PATCH.translation


def flight(rng: np.random.Generator, count: int, passes: int = 3) -> list[Pose]:
    """True poses, there and back along y, with sway and wobble."""
    each = -(-count // passes)
    along, poses = Rotation.from_euler('z', np.pi / 2), []
    for number in range(passes):
        for place in range(each)[:: -1 if number % 2 else 1]:
            at = np.array([APART * number, STEP * place, -DISTANCE]) + rng.normal(0, 0.006, 3)
            poses.append(Pose(along * Rotation.from_rotvec(rng.normal(0, 0.008, 3)), at))
    return poses[:count]


def pairs_of(poses: list[Pose]) -> list[tuple[int, int]]:
    """Clouds that are laid on each other, by the second's number."""
    places = np.array([pose.translation for pose in poses])
    tree, pairs = cKDTree(places), []
    for second in range(len(poses)):
        pairs += [(second - back, second) for back in (1, 3) if second >= back]
        if second % 4 == 0:
            near = tree.query(places[second], 24)[1]
            others = [n for n in near if n < second - 24][:2]
            pairs += [(int(n), second) for n in others]
    return pairs


def off_by(pose: Pose, twist: np.ndarray) -> Pose:
    """A pose, turned about the middle of the skin it sees, and shifted."""
    turn = Rotation.from_rotvec(twist[3:])
    shift = twist[:3] + CENTRE - turn.apply(CENTRE)
    return Pose(turn, shift) @ pose


def relatives(
    rng: np.random.Generator, poses: list[Pose], share: float, off: float
) -> tuple[list[tuple[int, int, RelativePose]], set[int]]:
    """What pairs tell, and the numbers of those that are false."""
    common = rng.multivariate_normal(np.zeros(6), COMMON)
    links, false = [], set()
    for number, (first, second) in enumerate(pairs_of(poses)):
        true = poses[first].inverse() @ poses[second]
        is_neighbour = second - first <= 3
        sigma = SIGMA * (1 if is_neighbour else 2)
        alike = in_common(CENTRE, PATCH.inverse() @ true @ PATCH)
        turn = np.kron(np.eye(2), PATCH.rotation.as_matrix())
        error = turn @ alike @ common + rng.normal(0, sigma)
        # The camera's x axis is along the flight.
        if not is_neighbour and rng.random() < share:
            error[0] += rng.choice([-1, 1]) * off
            false.add(number)
        information = np.diag(1 / np.square(sigma))
        found = RelativePose(off_by(true, error), CENTRE, information, 6, '', turn @ alike)
        links.append((first, second, found))
    return links, false


def joined(
    poses: list[Pose],
    links,
    seed: int,
    seen: Callable[[PoseGraph], Any] = lambda graph: None,
    stated: list[Pose] | None = None,
) -> tuple[PoseGraph, np.ndarray]:
    """The graph of a flight, seen pose by pose; processor time of each of them, and at the end."""
    stated, graph, spent = stated or erring(poses, seed), PoseGraph(), []
    by_second: dict[int, list] = {}
    for link in links:
        by_second.setdefault(link[1], []).append(link)
    for number in range(len(poses)):
        started = time.process_time()
        node = Node(stated[number], STATED, HALF_S * number, 0)
        guess = stated[number]
        if number:
            guess = graph.poses[-1] @ stated[number - 1].inverse() @ guess
        graph.add(node, guess)
        for first, second, found in by_second.get(number, []):
            graph.link(first, second, found)
            if second - first == 1:
                graph.follow(number)
        graph.update()
        spent.append(time.process_time() - started)
        seen(graph)
    started = time.process_time()
    graph.solve()
    return graph, np.array([*spent, time.process_time() - started])


def batch(graph: PoseGraph) -> PoseGraph:
    """The same, all at once, from where the autopilot says."""
    again = PoseGraph()
    for node in graph.nodes:
        again.add(node, node.stated)
    again.links[:] = graph.links
    again.solve()
    return again
