"""The map's origin on the earth: said and derived."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_vehicle import World

from ftp_dent_ros.navigation.origin import Origin

ORIGIN = Origin(47.45, 8.56, 430.0)
ORIGIN_ID = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN


def said(latitude: float = 47.45, longitude: float = 8.56, altitude: float = 430.0) -> Any:
    return mavlink.MAVLink_gps_global_origin_message(
        round(1e7 * latitude), round(1e7 * longitude), round(1e3 * altitude)
    )


def gps(fix: int = 3, altitude: int = 435_000, ellipsoid: int = 482_000) -> Any:
    return mavlink.MAVLink_gps_raw_int_message(
        0, fix, 474_500_000, 85_600_000, altitude, 1, 1, 0, 0, 9, alt_ellipsoid=ellipsoid
    )


def test_what_the_autopilot_says_is_the_origin() -> None:
    world = World().run(3)
    world.say(said())
    assert world.vehicle.earth.origin.distance(ORIGIN) < 0.01
    assert math.isnan(world.vehicle.earth.origin.altitude)
    world.say(gps())
    assert world.vehicle.earth.origin.above_sea == pytest.approx(430.0)
    assert world.vehicle.earth.origin.altitude == pytest.approx(477.0)
    world.say(said(latitude=47.46))
    assert world.vehicle.earth.origin.latitude == pytest.approx(47.46)


@pytest.mark.parametrize(
    'message', [said(0, 0), said(91, 8), said(47, 185), gps(fix=1), gps(ellipsoid=0)]
)
def test_what_is_no_place_is_not_taken(message: Any) -> None:
    world = World().run(0.1)
    world.say(message)
    assert world.vehicle.earth.origin is None


def test_the_origin_is_asked_for_until_it_is_known_and_again_after_a_reboot() -> None:
    world = World().run(10)
    assert 3 <= world.asked.count(ORIGIN_ID) <= 4
    world.say(said())
    world.asked.clear()
    assert ORIGIN_ID not in world.run(5).asked
    world.boot = world.now - 10**9
    assert ORIGIN_ID in world.run(2).asked
    assert world.vehicle.earth.origin is None


@pytest.mark.parametrize('latitude', [-60.0, 0.0, 47.0, 80.0])
def test_metres_are_those_of_the_ellipsoid(latitude: float) -> None:
    # Earth-centred coordinates of both places, an independent way round.
    origin = Origin(latitude, 8.0, 100.0).moved(np.array([-30.0, 40.0, -5.0]))
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
