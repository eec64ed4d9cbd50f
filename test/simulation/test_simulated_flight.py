"""The drone's flight, and what an autopilot estimates of it."""

import numpy as np
import pytest

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.flight import EstimateErrors, Flight

MIDDLE = Pose.from_rpy([0.02, -0.03, 0.6], [3.0, -2.0, 5.0])
NONE = np.zeros(3)


def flight(**changes):
    values = {
        'middle': MIDDLE,
        'length': 3.0,
        'speed': 0.2,
        'sway': np.array([0.03, 0.02, 0.01]),
        'wobble': np.array([0.04, 0.05, 0.06]),
    }
    return Flight(**{**values, **changes})


def test_it_goes_there_and_back_along_its_track():
    plain = flight(sway=NONE, wobble=NONE)
    period = plain.period_ns / 1e9
    assert period == pytest.approx(2 * 3.0 / 0.2)
    start, turn, end = (plain.pose(t).translation for t in (0.0, period / 2, period))
    left = MIDDLE.rotation.apply([0, 1, 0])
    np.testing.assert_allclose(start, MIDDLE.translation - 1.5 * left, atol=1e-9)
    np.testing.assert_allclose(turn, MIDDLE.translation + 1.5 * left, atol=1e-9)
    np.testing.assert_allclose(end, start, atol=1e-9)
    half = plain.pose(period / 4)
    np.testing.assert_allclose(half.translation, MIDDLE.translation, atol=1e-9)
    np.testing.assert_allclose(half.quaternion, MIDDLE.quaternion, atol=1e-12)


def test_sway_and_wobble_keep_their_limits():
    swaying = flight(length=1e-6)
    offsets, turns = [], []
    for seconds in np.linspace(0, 30, 400):
        relative = MIDDLE.inverse() @ swaying.pose(seconds * 1e-6)
        offsets.append(relative.translation)
        turns.append(relative.rotation.as_euler('xyz'))
    assert (np.abs(offsets).max(axis=0) <= np.array([0.03, 0.0200011, 0.01])).all()
    assert (np.abs(turns).max(axis=0) <= np.array([0.04, 0.05, 0.06])).all()


@pytest.mark.parametrize('turns', [0, 1])
def test_an_estimate_does_not_jump_where_the_flight_begins_again(turns):
    errors = EstimateErrors(wander=(0.1, 0.1, 0.05), wander_period=7.0, yaw_wander=0.02)
    period = flight().period_ns / 1e9
    begin = turns * period
    before, after = (
        errors.estimated(flight(), (begin + off) % period, begin + off) for off in (-0.01, 0.01)
    )
    assert np.linalg.norm(after.translation - before.translation) < 0.02
