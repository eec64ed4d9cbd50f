"""The world: the skin, the drone and the camera agree on where things are."""

import dataclasses
from itertools import pairwise

import cv2
import numpy as np
import pytest
from boards import true_correspondences

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.files import find
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation.world import LiveWorld, read_world

START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope='module')
def world():
    return read_world('shipped:scene.yaml', START_NS)


@pytest.mark.parametrize('after_s', [0.0, 3.3, 100.0, 239.9, 1000.0])
def test_the_seen_surface_is_the_skin_from_the_cameras_pose(world, after_s):
    """Points that the camera sees, brought to the map by its pose, are on the skin."""
    stamp_ns = START_NS + round(after_s * 1e9)
    rays = np.array([[0, 0, 1], [0.2, 0.1, 1], [-0.3, 0.1, 1], [0.1, -0.15, 1]])
    points = world.seen_surface(stamp_ns).intersect(rays)[:, None] * rays
    assert (np.abs(points[:, 2] - 0.8) < 0.15).all()
    in_map = world.camera_pose(stamp_ns).apply(points)
    assert np.abs(world.surface.distance(in_map)).max() < 1e-9
    assert np.abs(world.seen_surface(stamp_ns).distance(points)).max() < 1e-9


def test_the_camera_is_mounted_on_the_drone(world):
    stamp_ns = START_NS + 12_345_678_901
    base, camera = world.base_pose(stamp_ns), world.camera_pose(stamp_ns)
    ahead, left, up = base.rotation.apply(np.eye(3))
    right, down, forward = camera.rotation.apply(np.eye(3))
    np.testing.assert_allclose([right, down, forward], [-left, -up, ahead], atol=1e-12)
    np.testing.assert_allclose(camera.translation, base.translation + 0.1 * ahead, atol=1e-12)


def test_the_flight_is_periodic_and_exact_at_any_date(world):
    period = world.flight.period_ns
    for times in (-3, 1, 100_000):
        early, late = (world.base_pose(START_NS + 777 + n * period) for n in (0, times))
        np.testing.assert_allclose(late.translation, early.translation, atol=1e-12)
    a, b = (world.base_pose(START_NS + 5_000_000_000 + ns).translation for ns in (0, 1000))
    speed, _ = world.flight.rates(5.0)
    np.testing.assert_allclose((b - a) / 1e-6, speed, atol=1e-6)


def test_motion_is_that_of_the_skin_before_the_camera(world):
    """A point of the skin, seen at the exposure's begin and end."""
    stamp_ns, half_ns = START_NS + 9_000_000_000, 1_500_000
    assert world.exposure_time == 0.003
    motion = world.motion(stamp_ns)
    point = world.camera_pose(stamp_ns).apply(np.array([0.1, 0.05, 0.8]))
    begin, end = (
        world.camera_pose(stamp_ns + shift).inverse().apply(point) for shift in (-half_ns, half_ns)
    )
    turn, _ = cv2.Rodrigues(motion.rotation)
    np.testing.assert_allclose(turn @ begin + motion.translation, end, atol=1e-12)
    assert 1e-5 < np.linalg.norm(end - begin) < 1e-3


def test_a_photograph_is_the_same_each_time(world, rig, pattern):
    first, again, later = (
        world.photograph(rig, pattern.draw(), START_NS + ns).shown() for ns in (0, 0, 500_000_000)
    )
    assert (first == again).all()
    assert (first != later).any()
    assert world.photograph(rig, 0 * pattern.draw(), START_NS).shown().mean() < first.mean()
    other = dataclasses.replace(world, seed=world.seed + 1)
    assert (other.photograph(rig, pattern.draw(), START_NS).shown() != first).any()


def test_a_board_is_moved_by_the_second_white_photograph_in_a_row(rig, pattern):
    """As a capture takes them between two poses, and never amid the photographs of one."""
    world = LiveWorld('shipped:board_scene.yaml', 0)
    shipped = read_rig(find('shipped:rig.yaml'))
    size = (shipped.projector.height, shipped.projector.width, 3)
    white, black = np.full(size, 254, np.uint8), np.zeros(size, np.uint8)
    board = Board(10, 7, 0.025)
    corners = []
    for image in (white, white, white, black, white, white):
        photograph = world.photograph(shipped, image, 0)
        if image is white:
            corners.append(board.find(photograph.shown()[..., 1]))
    moved = [np.abs(b - a).max() > 5 for a, b in pairwise(corners)]
    assert moved == [True, False, False, True]


def test_the_shipped_board_is_seen_whole_in_each_of_its_poses():
    world, shipped = read_world('shipped:board_scene.yaml'), read_rig(find('shipped:rig.yaml'))
    assert len(world.board_poses) > 15
    for pose in world.board_poses:
        pixels = true_correspondences(Board(10, 7, 0.025), shipped, pose)
        for lens, pixel in zip((shipped.camera, shipped.projector), pixels, strict=True):
            assert (pixel > 5).all() and (pixel < [lens.width - 6, lens.height - 6]).all()
