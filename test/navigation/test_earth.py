"""The map's origin on the earth: said and derived."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_vehicle import World

from ftp_dent_ros.navigation.origin import Origin, origin_below
from ftp_dent_ros.navigation.settings import VehicleSettings

ORIGIN = Origin(47.45, 8.56, 430.0)
ORIGIN_ID = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
GLOBAL_ID = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


def said(latitude: float = 47.45, longitude: float = 8.56, altitude: float = 430.0) -> Any:
    return mavlink.MAVLink_gps_global_origin_message(
        round(1e7 * latitude), round(1e7 * longitude), round(1e3 * altitude)
    )


def gps(fix: int = 3, altitude: int = 435_000, ellipsoid: int = 482_000) -> Any:
    return mavlink.MAVLink_gps_raw_int_message(
        0, fix, 474_500_000, 85_600_000, altitude, 1, 1, 0, 0, 9, alt_ellipsoid=ellipsoid
    )


class Abroad(World):
    """Says where it is on the earth, too; moves north at 1 m/s, 5 m up."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(VehicleSettings(earth=True, **settings))
        self.grants = self.grants | {GLOBAL_ID}

    def _send(self, message_id: int) -> None:
        if message_id == GLOBAL_ID:
            north = (self.boot_ms() - 100_000) / 1e3
            self.say(
                mavlink.MAVLink_global_position_int_message(
                    self.boot_ms(),
                    round(1e7 * (47.45 + north / 111_180.0)),
                    85_600_000,
                    435_000,
                    *(5000, 0, 0, 0, 0),
                )
            )
        else:
            super()._send(message_id)

    @property
    def difference(self) -> str:
        return self.vehicle.figures(self.at)['origin differs from GLOBAL_POSITION_INT (m)']


def test_what_the_autopilot_says_is_the_origin() -> None:
    world = Abroad().run(3)
    world.say(said())
    assert world.vehicle.earth.origin.distance(ORIGIN) < 0.01
    assert math.isnan(world.vehicle.earth.origin.altitude)
    world.say(gps())
    assert world.vehicle.earth.origin.above_sea == pytest.approx(430.0)
    assert world.vehicle.earth.origin.altitude == pytest.approx(477.0)


def test_where_it_does_not_say_it_the_origin_is_below_its_position() -> None:
    world = Abroad().run(8)
    assert world.vehicle.earth.origin.distance(ORIGIN) < 0.05
    assert world.vehicle.earth.origin.above_sea == pytest.approx(430.0, abs=1e-3)
    assert world.difference == 'unknown'
    world.say(said(longitude=8.5602))
    assert float(world.difference) == pytest.approx(0.0002 * 75_390, abs=0.1)


@pytest.mark.parametrize(
    'message', [said(0, 0), said(91, 8), said(47, 185), gps(fix=1), gps(ellipsoid=0)]
)
def test_what_is_no_place_is_not_taken(message: Any) -> None:
    world = Abroad().run(0.1)
    world.say(message)
    assert world.vehicle.earth.origin is None


def test_the_origin_is_asked_for_until_it_is_known_and_again_after_a_reboot() -> None:
    world = Abroad()
    world.grants = world.grants - {GLOBAL_ID}
    world.run(10)
    assert 3 <= world.asked.count(ORIGIN_ID) <= 4
    world.say(said())
    world.say(gps())
    world.asked.clear()
    world.run(5)
    assert ORIGIN_ID not in world.asked
    world.boot = world.now - 10**9
    world.run(2)
    assert world.vehicle.earth.origin is None
    assert ORIGIN_ID in world.asked


def test_without_the_wish_the_origin_alone_is_asked_that_a_move_is_seen() -> None:
    world = World().run(5)
    assert world.asked.count(ORIGIN_ID) == 1
    world.say(said())
    assert world.vehicle.earth.origin.latitude == pytest.approx(47.45)
    world.say(said(latitude=47.46))
    assert world.vehicle.earth.origin.latitude == pytest.approx(47.46)


@pytest.mark.parametrize('latitude', [-60.0, 0.0, 47.0, 80.0])
def test_metres_are_those_of_the_ellipsoid(latitude: float) -> None:
    # Earth-centred coordinates of both places, an independent way round.
    origin = origin_below(Origin(latitude, 8.0, 100.0), np.array([30.0, -40.0, 5.0]))
    chord = np.linalg.norm(ecef(origin) - ecef(Origin(latitude, 8.0, 100.0)))
    assert chord == pytest.approx(math.sqrt(30**2 + 40**2 + 5**2), abs=2e-3)
    assert origin.latitude > latitude and origin.longitude < 8.0
    assert origin.distance(Origin(latitude, 8.0, 0.0)) == pytest.approx(50.0, abs=2e-3)


def ecef(place: Origin) -> np.ndarray:
    phi, lam = math.radians(place.latitude), math.radians(place.longitude)
    normal = 6_378_137.0 / math.sqrt(1 - 6.69437999014e-3 * math.sin(phi) ** 2)
    across = (normal + place.above_sea) * math.cos(phi)
    up = (normal * (1 - 6.69437999014e-3) + place.above_sea) * math.sin(phi)
    return np.array([across * math.cos(lam), across * math.sin(lam), up])
