"""Interpolation against motions that are known as functions of time."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.pose_history import PoseHistory, Sample

MS = 1_000_000


class Circle:
    """Flight on a circle at a speed (m/s), nose ahead, which turns at a rate (rad/s)."""

    def __init__(self, speed: float = 2.0, rate: float = np.radians(60)) -> None:
        self.speed, self.rate = speed, rate

    def position(self, stamp: int) -> np.ndarray:
        angle, radius = self.rate * stamp / 1e9, self.speed / self.rate
        return np.array([radius * np.cos(angle), radius * np.sin(angle), 5.0])

    def velocity(self, stamp: int) -> np.ndarray:
        angle = self.rate * stamp / 1e9
        return self.speed * np.array([-np.sin(angle), np.cos(angle), 0.0])

    def attitude(self, stamp: int) -> Rotation:
        heading = np.pi / 2 + self.rate * stamp / 1e9
        return Rotation.from_euler('ZX', [heading, 0.2])

    def body_rate(self, stamp: int) -> np.ndarray:
        return self.attitude(stamp).inv().apply([0.0, 0.0, self.rate])

    def feed(
        self,
        history: PoseHistory,
        attitudes: Iterable[int],
        positions: Iterable[int],
        turned: Callable[[int, Rotation], np.ndarray] = lambda stamp, turn: turn.as_quat(),
    ) -> PoseHistory:
        """Samples at some milliseconds; `turned` is what is said of an attitude."""
        for stamp in attitudes:
            said = turned(stamp, self.attitude(stamp * MS))
            history.add(stamp * MS, Sample(said, self.body_rate(stamp * MS)), None)
        for stamp in positions:
            place, speed = self.position(stamp * MS), self.velocity(stamp * MS)
            history.add(stamp * MS, None, Sample(place, speed))
        return history


def reason_at(history: PoseHistory, stamp: int) -> str:
    with pytest.raises(PoseError) as refusal:
        history.at(stamp)
    return refusal.value.reason


def test_at_50_hz_interpolation_costs_under_2_mm_and_a_twentieth_of_a_degree() -> None:
    circle, stamps = Circle(), range(0, 2001, 20)
    history = circle.feed(PoseHistory(), stamps, stamps)
    for stamp in range(0, 2000 * MS, 3_333_333):
        pose, _ = history.at(stamp)
        assert np.linalg.norm(pose.translation - circle.position(stamp)) < 0.15e-3
        turn = (pose.rotation.inv() * circle.attitude(stamp)).magnitude()
        assert np.degrees(turn) < 0.05
    assert history.resets == 0


def test_a_change_of_the_quaternions_sign_is_no_motion() -> None:
    history, circle, stamps = PoseHistory(), Circle(), range(0, 200, 20)
    circle.feed(history, stamps, stamps, lambda at, turn: (-1) ** (at // 20) * turn.as_quat())
    turn = (history.at(50 * MS)[0].rotation.inv() * circle.attitude(50 * MS)).magnitude()
    assert np.degrees(turn) < 0.01
    assert history.resets == 0


def test_nothing_is_extrapolated_nor_interpolated_across_a_gap() -> None:
    stamps = [*range(0, 200, 20), *range(360, 600, 20)]  # 180 ms without a sample
    history = Circle().feed(PoseHistory(maximum_gap=0.15), stamps, stamps)
    for at, reason in ((-1, 'too old'), (200, 'gap in the samples'), (359, 'gap in the samples')):
        assert reason_at(history, at * MS) == reason
    assert_allclose(history.at(360 * MS)[0].translation, Circle().position(360 * MS))
    assert history.at(150 * MS) and history.at(400 * MS)
    only_attitude = Circle().feed(PoseHistory(), range(0, 100, 20), range(0))
    for none, at in ((history, 580 * MS + 1), (only_attitude, 50 * MS)):
        with pytest.raises(PoseAwaitedError, match='no ') as awaited:
            none.at(at)
        assert awaited.value.reason == 'later sample awaited'


def test_a_yaw_reset_is_seen_and_not_interpolated_across() -> None:
    def turned(stamp: int, turn: Rotation) -> np.ndarray:
        reset = Rotation.from_euler('z', 2.46 if stamp >= 200 else 0.0, degrees=True)
        return (reset * turn).as_quat()

    history = Circle().feed(PoseHistory(), range(0, 400, 20), range(0, 400, 20), turned)
    assert history.resets == 1
    assert reason_at(history, 181 * MS) == 'estimator reset'
    assert reason_at(history, 199 * MS) == 'estimator reset'
    assert history.at(180 * MS) and history.at(200 * MS)


@pytest.mark.parametrize('step', [5, 20, 100])
def test_rough_flying_is_no_reset(step: int) -> None:
    # 200 degrees a second at 5 m/s: 17 m/s2.
    circle = Circle(speed=5.0, rate=np.radians(200))
    history = circle.feed(PoseHistory(), range(0, 3000, step), range(0, 3000, step))
    assert history.resets == 0
