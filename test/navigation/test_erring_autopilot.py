"""The bridge's logic on the simulated autopilot as it errs and fails, in virtual time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_vehicle import GRANTED, MS, START, S, World

from ftp_dent_ros.errors import PoseError
from ftp_dent_ros.navigation.settings import VehicleSettings
from ftp_dent_ros.simulation.autopilot import Telemetry
from ftp_dent_ros.simulation.flight import EstimateErrors, Faults
from ftp_dent_ros.simulation.world import read_world

# As a real ArduCopter was measured: 2.5 cm rms, 10 cm largest, 1 degree.
MEASURED = EstimateErrors(
    offset=(0.01, -0.01, 0.0),
    wander=(0.05, 0.05, 0.03),
    wander_period=20.0,
    lag=0.02,
    yaw=0.01,
    yaw_wander=0.01,
)


class Simulated(World):
    """The shipped scene's flight, as its autopilot tells it."""

    def __init__(
        self,
        errors: EstimateErrors | None = None,
        faults: Faults | None = None,
        settings: VehicleSettings | None = None,
        height: float | None = None,
    ) -> None:
        super().__init__(settings)
        self.grants = GRANTED | {mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT}
        scene = read_world('shipped:scene.yaml', START)
        if height is not None:
            flight = scene.flight
            up = np.array([0.0, 0.0, height - flight.middle.translation[2]])
            middle = replace(flight.middle, translation=flight.middle.translation + up)
            scene = replace(scene, flight=replace(flight, middle=middle))
        self.scene = replace(scene, errors=errors or EstimateErrors(), faults=faults or Faults())
        self.telemetry = Telemetry(self.scene, self.boot, START - self.boot)

    def _send(self, message_id: int) -> None:
        self.say(self.telemetry.messages[message_id](self.now - self.boot))

    def errors(self, begin: float, end: float) -> dict[float, np.ndarray]:
        """Errors by the deviations stated, and in metres, of the tags of a time; shape (2, 6)."""
        found = {}
        for stamp in range(START + round(begin * S), START + round(end * S), 100 * MS):
            tag = tag_of(self, stamp)
            if tag is not None:
                true = self.scene.base_pose(stamp)
                turn = (tag.pose.rotation * true.rotation.inv()).as_rotvec()
                error = np.array([*(tag.pose.translation - true.translation), *turn])
                deviations = np.sqrt(np.diag(tag.covariance))
                found[(stamp - START) / S] = np.stack([error / deviations, error])
        return found


def tag_of(world: World, stamp: int) -> Any:
    try:
        return world.vehicle.tag_at(stamp, world.at)
    except PoseError:
        return None


def test_the_measured_errors_are_covered_by_what_is_stated() -> None:
    world = Simulated(MEASURED)
    found = []
    for _ in range(5):
        world.run(5)
        end = (world.now - START) / S - 0.5
        found += world.errors(max(2.0, end - 4.5), end).values()
    ratios, errors = np.transpose(found, (1, 0, 2))
    rms = np.sqrt(np.mean(errors[:, :3] ** 2, axis=0))
    assert np.all((rms > 0.01) & (rms < 0.04)) and np.abs(errors[:, :3]).max() < 0.1
    assert np.degrees(np.abs(errors[:, 5])).max() < 1.3
    # Wanders are slow: the ratios of one flight are not those of many flights.
    assert np.mean(np.abs(ratios) < 2) > 0.95
    assert 0.3 < np.sqrt(np.mean(ratios[:, [0, 1, 5]] ** 2)) < 1.4


@pytest.mark.parametrize('height', [3.0, 8.0])
def test_a_barometers_scale_is_stated_within_a_factor_of_two(height: float) -> None:
    world = Simulated(EstimateErrors(height_scale=0.037), height=height).run(5)
    ratios = np.array([ratio[2] for ratio, _ in world.errors(2, 4.5).values()])
    assert len(ratios) == 25
    assert np.all((ratios > 0.5) & (ratios < 2))


def test_of_a_lost_gps_no_tag_goes_out_that_is_not_true() -> None:
    world = Simulated(faults=Faults(gps_lost_from=4.0, gps_lost_for=9.0)).run(14)
    tags = world.errors(4.0, 13.5)
    lost = [at for at in tags if at < 13.0]
    assert max(lost, default=4.0) < 4.3
    assert all(np.abs(ratio[:3]).max() < 2 for ratio, _ in tags.values())
    with pytest.raises(PoseError, match='GPS has no fix'):  # the cause, not what comes of it
        world.vehicle.tag_at(START + 8 * S, world.at)
    assert world.figure('estimator resets') > 0  # the estimate jumps back
    world.run(2)
    assert len(world.errors(14.0, 15.5)) == 15
    # It had drifted off by a metre and a half, and the autopilot said for 7 s that it was ready.
    assert np.linalg.norm(world.scene.faults.drift(12.9)) > 1.5
