"""Others on the link: who changes the rates, what is lost, what takes too long."""

from __future__ import annotations

import numpy as np
import pytest
from test_vehicle import MS, S, World, tagged

from ftp_dent_ros.errors import PoseError
from ftp_dent_ros.navigation.settings import VehicleSettings


def test_another_client_that_changes_the_rates_each_second_costs_few_poses() -> None:
    world = World().run(5)
    world.poses.clear()
    begin = world.now
    for _ in range(8):
        for message_id in (31, 32):
            world.intervals[message_id] = 500_000
        world.run(1)
    stamps = range(begin, world.now - 500 * MS, 50 * MS)
    share = np.mean([tagged(world, stamp) for stamp in stamps])
    assert share > 0.75
    world.run(12)
    assert world.verdict() == 'believing the autopilot 1/1'


def test_round_trips_that_are_too_long_name_the_remedy() -> None:
    for allowed, is_known in ((0.01, False), (0.03, True)):
        world = World(VehicleSettings(maximum_clock_error=allowed))
        world.round_trip = 45 * MS
        world.run(6)
        assert world.vehicle.clock.is_converged(world.at.ros) is is_known
        if is_known:
            assert world.pose_at(0.5)
        else:
            assert 'set maximum_clock_error to 0.030' in world.verdict()
            assert 'the quickest answers to TIMESYNC take 5' in world.verdict()
            with pytest.raises(PoseError, match=r'set maximum_clock_error to 0\.030'):
                world.pose_at(0.5)


@pytest.mark.parametrize('step', [0.3, -4.1, 3600.0])
@pytest.mark.parametrize('at', ['between exchanges', 'in an exchange'])
def test_a_step_of_the_computers_clock_is_called_that(step: float, at: str) -> None:
    world = World(VehicleSettings(maximum_clock_error=0.02))
    world.round_trip = 15 * MS
    world.run(6)
    if at == 'in an exchange':
        while not world._answers:
            world.run(0.01)
    world.ahead += round(step * S)
    verdicts = set()
    for _ in range(100):
        verdicts.add(world.run(0.2).verdict())
    assert not any('maximum_clock_error' in each or 'cable' in each for each in verdicts), verdicts
    assert world.verdict() == 'believing the autopilot 1/1'
    assert world.vehicle.tag_at(world.at.ros - 500 * MS, world.at)
