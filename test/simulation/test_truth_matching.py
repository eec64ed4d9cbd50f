"""Found places are paired with true ones, one each at most."""

import numpy as np
import pytest

from ftp_dent_ros.simulation.truth import match_truth

TRUE = np.array([[0.0, 0.0, 0.8], [0.03, 0.0, 0.8], [0.2, 0.0, 0.8]])


def at(*x: float) -> np.ndarray:
    return np.array([[each, 0.0, 0.8] for each in x]).reshape(-1, 3)


@pytest.mark.parametrize(
    ('found', 'pairs'),
    [
        ((), {}),
        ((0.201, 0.001), {0: 1, 2: 0}),
        ((0.001, 0.002), {0: 0}),
        ((0.014, 0.016), {0: 0, 1: 1}),
        ((0.016,), {1: 0}),
        ((0.1,), {}),
    ],
)
def test_the_nearest_within_reach_is_taken_once(found, pairs):
    assert match_truth(at(*found), TRUE, 0.02) == pairs


def test_no_found_place_is_left_out_for_a_nearer_one():
    # The middle one is nearest to both, the other is the first one's alone.
    assert match_truth(at(0.014, -0.016), TRUE, 0.02) == {0: 1, 1: 0}


def test_what_may_not_be_a_pair_is_none():
    may_be = np.array([[False, True, True]])
    assert match_truth(at(0.0), TRUE, 0.05, may_be) == {1: 0}
    assert match_truth(at(0.0), (), 0.05) == {}
