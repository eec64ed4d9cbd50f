from __future__ import annotations

import numpy as np
from boards import random_pose, true_correspondences

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.guidance import covered, next_pose, projector_delay
from ftp_dent_ros.calibration.observing import Observation

BOARD = Board(7, 6, 0.03)
SIZE = 1280, 720


def test_the_next_pose_is_one_that_both_see_and_that_helps(rig):
    rng = np.random.default_rng(4)
    seen = []
    known = []
    for index in range(5):
        advice, deviation = next_pose(seen, BOARD, SIZE, SIZE)
        assert advice.startswith('hold the board ')
        known.append(deviation)
        camera, projector = true_correspondences(BOARD, rig, random_pose(BOARD, rig, 0.7, rng))
        noise = rng.normal(0, 0.02, camera.shape)
        seen.append(Observation(f'pose_{index}', camera + noise, projector + noise))
    assert np.isnan(known[:4]).all()
    assert next_pose(seen, BOARD, SIZE, SIZE)[1] < known[4]
    assert 0.3 < covered(seen, SIZE) <= 1


class Rig:
    """A projector that is late and not linear, before a camera at 20 images a second."""

    def __init__(self, delay, gamma):
        self.delay, self.gamma = delay, gamma
        self.now = 0.0
        self.shown = [(-1.0, 0)]

    def show(self, image):
        self.shown.append((self.now + self.delay, int(image[0, 0, 0])))
        return round(1e9 * self.now)

    def photograph(self, after_ns):
        self.now = max(self.now + 0.05, after_ns / 1e9)
        level = [level for since, level in self.shown if since <= self.now][-1]
        light = 10 + 200 * (level / 254) ** self.gamma
        return np.full((6, 8), round(light), np.uint8), round(1e9 * self.now)


def test_the_delay_of_a_projector_is_measured():
    rig = Rig(0.12, 2.2)
    delay = projector_delay(rig.show, rig.photograph, (8, 6))
    assert 0.12 <= delay <= 0.17 + 1e-9
    assert projector_delay(Rig(0.0, 1.0).show, Rig(0.0, 1.0).photograph, (8, 6)) == 0.0
