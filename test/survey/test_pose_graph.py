"""Twists, and a graph of poses whose pairs tell some directions only, without any clouds."""

from __future__ import annotations

import numpy as np
import pytest
from flown_skin import STATED, erring
from scipy.linalg import logm
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import spread_of_shift, twists
from ftp_dent_ros.survey.information import COMMON, RelativePose, in_common
from ftp_dent_ros.survey.pose_graph import Node, PairLink, PoseGraph

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


def joined(poses: list[Pose], links, seed: int, stated: list[Pose] | None = None) -> PoseGraph:
    """The graph of a flight, pose by pose."""
    stated, graph = stated or erring(poses, seed), PoseGraph()
    for number, guess in enumerate(stated):
        if number:
            guess = graph.poses[-1] @ stated[number - 1].inverse() @ guess
        graph.add(Node(stated[number], STATED, HALF_S * number, 0), guess)
        for first, second, found in links:
            if second == number:
                graph.links.append(PairLink(first, second, found))
                if second - first == 1:
                    graph.put(number, graph.pose(first) @ found.pose)
        graph.update()
    graph.solve()
    return graph


def batch(graph: PoseGraph) -> PoseGraph:
    """The same, all at once, from where the autopilot says."""
    again = PoseGraph()
    for node in graph.nodes:
        again.add(node, node.stated)
    again.links[:] = graph.links
    again.solve()
    return again


RADIUS = 2.0


def test_twists_are_logarithms_of_motions():
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = turn, [0.1, 0.2, -0.3]
    np.testing.assert_allclose(
        twists(turn, whole[:3, 3]), [*logm(whole)[:3, 3], 0.3, -0.2, 0.5], atol=1e-9
    )


def test_a_shift_along_an_arc_has_the_spread_that_is_told():
    rng = np.random.default_rng(3)
    root = 0.3 * rng.normal(size=(6, 6))
    drawn = rng.multivariate_normal(np.zeros(6), root @ root.T, 200_000)
    arcs = np.array(np.cross(drawn[:, 3:], drawn[:, :3]) / 2)
    grown = (spread_of_shift((root @ root.T)[None])[0] - root @ root.T)[:3, :3]
    np.testing.assert_allclose(grown, arcs.T @ arcs / len(arcs), rtol=0.05, atol=2e-3)


def test_a_cylinder_may_slide_far_and_its_pairs_still_agree():
    """What pairs tell holds along the whole slide, not where it was worked out alone."""
    axis = np.array([0.0, 0.0, -RADIUS])

    def around(angle):
        turn = Rotation.from_rotvec([angle, 0, 0])
        return Pose(turn, axis - turn.apply(axis))

    # Heights and tilts are told to a micrometre; neither the place along nor that around.
    free = np.zeros((6, 2))
    free[0, 0] = 1
    free[:, 1] = [0, -RADIUS, 0, 1, 0, 0]
    free[:, 1] /= np.linalg.norm(free[:, 1])
    kept = np.linalg.svd(free)[0][:, 2:]
    information = kept @ kept.T * 1e12
    graph = PoseGraph()
    rng = np.random.default_rng(5)
    for number in range(6):
        off = rng.multivariate_normal(np.zeros(6), STATED)
        stated = Pose(Rotation.from_rotvec(off[3:]), off[:3])
        graph.add(Node(stated, STATED, 100.0 * number, 0), stated)
        if number:
            # As they were found: slid by some centimetres.
            found = around(rng.normal(0, 0.02)) @ Pose(
                Rotation.identity(), np.array([rng.normal(0, 0.03), 0, 0])
            )
            relative = RelativePose(found, np.zeros(3), information, 4)
            graph.links.append(PairLink(number - 1, number, relative))
    # A pair that tells nothing.
    graph.links.append(PairLink(0, 5, RelativePose(stated, np.zeros(3), np.zeros((6, 6)), 0)))
    graph.solve()
    assert not graph.left_out
    # All lie on one cylinder: what takes one to another turns about its axis.
    for pose in graph.poses[1:]:
        seen = graph.poses[0].inverse() @ pose
        assert np.linalg.norm((seen.apply(axis) - axis)[1:]) < 1e-5


def farthest(poses, others):
    return max(
        np.linalg.norm(a.apply(CENTRE) - b.apply(CENTRE))
        for a, b in zip(poses, others, strict=True)
    )


@pytest.mark.parametrize(('share', 'off'), [(0.1, 0.025), (0.3, 0.05)])
def test_false_pairs_between_passes_are_left_out_and_the_map_is_not_bent(share, off):
    """Rivets look alike: some pairs are off by a pitch or two, and state that they are not."""
    rng = np.random.default_rng([33, round(10 * share)])
    poses = flight(rng, 54)
    links, false = relatives(rng, poses, share, off)
    assert false
    graph = joined(poses, links, 3)
    assert graph.left_out == false, 'all false ones are told, and no true one'
    without = [link for number, link in enumerate(links) if number not in false]
    clean = joined(poses, without, 3)
    assert farthest(graph.poses, clean.poses) < 2e-5
    assert farthest(graph.poses, batch(graph).poses) < 1e-6, 'as all at once'


def test_an_autopilot_that_jumps_is_overruled():
    rng = np.random.default_rng(1)
    poses = flight(rng, 36, passes=1)
    links, _ = relatives(rng, poses, 0.0, 0.0)
    step = np.array([0, 2.0, 0])
    stated = [
        Pose(each.rotation, each.translation + step * (number >= 24))
        for number, each in enumerate(erring(poses, 5))
    ]
    graph = joined(poses, links, 5, stated)
    assert not graph.left_out and len(set(graph.groups())) == 1
    first, true = graph.poses[0].inverse(), poses[0].inverse()
    seen = [first @ pose for pose in graph.poses]
    assert farthest(seen, [true @ pose for pose in poses]) < 2e-3


@pytest.mark.parametrize('constant', [True, False])
def test_a_place_is_as_uncertain_as_its_flights_error_is_constant(constant):
    """What does not change within a flight does not average out, however long it is."""
    ratios, stated = [], []
    for seed in range(4):
        rng = np.random.default_rng([8, seed])
        poses = flight(rng, 90)
        said = erring(poses, seed, 4.0)
        if constant:
            off = rng.multivariate_normal(np.zeros(6), STATED)
            turn = Rotation.from_rotvec(off[3:])
            said = [Pose(turn * each.rotation, each.translation + off[:3]) for each in poses]
        links, _ = relatives(rng, poses, 0.0, 0.0)
        graph = PoseGraph()
        for number, each in enumerate(said):
            graph.add(Node(each, STATED, 4.0 * number, 0), each)
            for first, second, found in links:
                if second == number:
                    graph.links.append(PairLink(first, second, found))
        graph.settle()
        spread = graph.covariances()[45]
        off = graph.poses[45].translation - poses[45].translation
        ratios.append(off @ np.linalg.solve(spread[:3, :3], off) / 3)
        stated.append(np.sqrt(np.trace(spread[:3, :3]) / 3))
    assert 0.1 < np.mean(ratios) < 2.5
    # Of 30 mm that are stated: all of it, or what 360 s leave of a drift of some seconds.
    assert np.mean(stated) > 0.027 if constant else np.mean(stated) < 0.015


def test_a_cloud_that_comes_late_is_as_near_in_time_as_one_that_comes_early():
    placed = []
    for seconds in ((0.0, 4.0, 8.0), (8.0, 4.0, 0.0)):
        graph, rng = PoseGraph(), np.random.default_rng(2)
        for number, time in enumerate(seconds):
            off = rng.multivariate_normal(np.zeros(6), STATED)
            stated = Pose(Rotation.from_rotvec(off[3:]), off[:3])
            graph.add(Node(stated, STATED, time, 0), stated)
            if number:
                information = np.diag(1 / np.square(SIGMA))
                found = RelativePose(Pose.from_rpy((0, 0, 0), (0, 0, 0)), CENTRE, information, 6)
                graph.links.append(PairLink(number - 1, number, found))
        graph.settle()
        placed.append(graph.poses)
    assert farthest(*placed) < 1e-6


def test_a_pose_seen_from_another_errs_by_both():
    """Where the autopilot alone tells, each of the two is as uncertain as it states."""
    graph, none = PoseGraph(), Pose(Rotation.identity(), np.zeros(3))
    for number in range(2):
        graph.add(Node(none, STATED, 1e4 * number, 0), none)
    seen = graph.covariances(anchor=0)
    np.testing.assert_allclose(np.diag(seen[1]), 2 * np.diag(STATED), rtol=0.02)
    np.testing.assert_allclose(seen[0], 0, atol=1e-15)
