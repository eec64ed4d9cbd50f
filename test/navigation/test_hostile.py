"""Twenty thousand messages that mean no good, amid those of a vehicle that flies on."""

from __future__ import annotations

import gc
import random

import pytest
from hostile_mavlink import hostile
from test_vehicle import MS, START, S, World, tagged

from ftp_dent_ros.navigation.link import Roster
from ftp_dent_ros.navigation.signing import Codec

MESSAGES = 20_000
AT_ONCE = 80


def test_no_wrong_tag_and_no_growth() -> None:
    rng = random.Random(8)
    world, codec, roster = World().run(2), Codec(), Roster()
    codec.restart(True)
    enemies = hostile(rng)
    objects, given = [], 0
    for count in range(0, MESSAGES, AT_ONCE):
        for _ in range(AT_ONCE):
            for message in codec.messages(next(enemies), world.now):
                roster.hear(message)
                world.vehicle.receive(message, world.at)
        world.run(0.02)
        given += tagged(world, world.now - rng.randrange(100 * MS, S))
        if count in (MESSAGES // 2, MESSAGES - AT_ONCE):
            gc.collect()
            objects.append(len(gc.get_objects()))
    for stamp, pose in world.poses:
        assert pose.translation[1] == pytest.approx((stamp - START) / S, abs=3e-3)
    assert given > 0 and len(world.poses) > 100
    assert objects[1] - objects[0] < 2000
    assert codec.bad_bytes > MESSAGES // 4
    assert world.figure('messages malformed') > MESSAGES // 8
    world.run(3)
    assert tagged(world, world.now - S)
