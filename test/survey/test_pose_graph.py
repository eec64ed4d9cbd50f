"""Twists, and a graph of poses whose pairs tell some directions only."""

from __future__ import annotations

import numpy as np
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.poses.pose_graph import PoseGraph
from ftp_dent_ros.survey.poses.stated_poses import Node
from ftp_dent_ros.survey.registration.relative_pose import RelativePose
from ftp_dent_ros.survey.registration.twists import changes, spread_of_shift, twists

STATED = np.diag([0.03**2] * 3 + [0.015**2] * 3)
RADIUS = 2.0


def motion(twist):
    """Rotation matrix and shift of a twist, as its exponential gives them."""
    turn = Rotation.from_rotvec(twist[3:])
    x, y, z = twist[3:]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    powers, total = np.eye(3), np.zeros((3, 3))
    for k in range(1, 20):
        total = total + powers
        powers = powers @ cross / (k + 1)
    return turn.as_matrix(), total @ twist[:3]


def test_twists_are_logarithms_of_motions():
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = turn, [0.1, 0.2, -0.3]
    np.testing.assert_allclose(
        twists(turn, whole[:3, 3]), [*logm(whole)[:3, 3], 0.3, -0.2, 0.5], atol=1e-9
    )


def test_twists_change_as_is_told():
    twist = np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.03])
    turn, shift = motion(twist)
    for axis, change in enumerate(changes(twist).T):
        step = 1e-6 * np.eye(6)[axis]
        after, moved = motion(step)
        found = (twists(after @ turn, after @ shift + moved) - twist) / 1e-6
        np.testing.assert_allclose(found, change, atol=2e-5)


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
            relative = RelativePose(found, np.zeros(3), information, 4, 1.0, 1e-6)
            graph.link(number - 1, number, relative)
    graph.link(0, 5, RelativePose(stated, np.zeros(3), np.zeros((6, 6)), 0, 1.0, 1e-6))
    assert graph.strained([0]) and not graph.strained([5]), 'a pair that tells nothing fits'
    graph.solve()
    assert not graph.left_out and not graph.strained(range(6))
    # All lie on one cylinder: what takes one to another turns about its axis.
    for pose in graph.poses[1:]:
        seen = graph.poses[0].inverse() @ pose
        assert np.linalg.norm((seen.apply(axis) - axis)[1:]) < 1e-5
