"""What pieces of two maps propose: agreed on, or chance."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.tying import REACH, agreeing

TRUE = Pose.from_rpy((0.1, -0.2, 2.0), (4.0, -3.0, 1.0))
# Of square metres that are searched.
CHANCE = np.pi * REACH**2


def proposals(rng, right, wrong):
    """Motions by pieces on a skin of a metre, so many of which are right, and their places."""
    places = rng.uniform(0, 1, (right + wrong, 3)) * [1, 1, 0]
    shifts = [rng.normal(0, 3e-4, 3) for _ in range(right)]
    shifts += [rng.uniform(-0.5, 0.5, 3) for _ in range(wrong)]
    turns = Rotation.from_rotvec(rng.normal(0, 1e-3, (right + wrong, 3)))
    motions = []
    for place, shift, turn in zip(places, shifts, turns, strict=True):
        rotation = turn * TRUE.rotation
        motions.append(Pose(rotation, TRUE.apply(place) + shift - rotation.apply(place)))
    return motions, places, np.arange(right + wrong)[:, None]


def test_what_pieces_agree_in_is_found_among_many_that_are_wrong():
    for seed in range(20):
        motions, places, pieces = proposals(np.random.default_rng(seed), 6, 40)
        found = agreeing(motions, places, pieces, CHANCE)
        assert set(found.tolist()) == set(range(6))


def test_what_one_piece_or_chance_says_is_nothing():
    for seed in range(100):
        motions, places, pieces = proposals(np.random.default_rng(seed), 1, 40)
        assert not len(agreeing(motions, places, pieces, CHANCE))
    # One piece says the same ever again.
    motions, places, pieces = proposals(np.random.default_rng(1), 6, 0)
    assert not len(agreeing(motions, places, 0 * pieces, CHANCE))
    assert not len(agreeing([], places[:0], pieces[:0], CHANCE))
