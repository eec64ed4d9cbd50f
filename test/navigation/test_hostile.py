"""Twenty thousand messages that mean no good, amid those of a vehicle that flies on."""

from __future__ import annotations

import gc
import math
import random
import struct
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_vehicle import MS, START, S, World, tagged

from ftp_dent_ros.navigation.link import Roster
from ftp_dent_ros.navigation.signing import Codec

MESSAGES = 20_000
AT_ONCE = 80
NAMES = [
    'HEARTBEAT',
    'TIMESYNC',
    'SYSTEM_TIME',
    'COMMAND_ACK',
    'COMMAND_LONG',
    'STATUSTEXT',
    'EKF_STATUS_REPORT',
    'ESTIMATOR_STATUS',
    'ATTITUDE_QUATERNION',
    'LOCAL_POSITION_NED',
    'GLOBAL_POSITION_INT',
    'GPS_GLOBAL_ORIGIN',
    'ODOMETRY',
    'DISTANCE_SENSOR',
    'REQUEST_DATA_STREAM',
]


def frame(name: str, payload: bytes, system: int, component: int) -> bytes:
    """A message with any payload and the right checksum."""
    message_id = getattr(mavlink, f'MAVLINK_MSG_ID_{name}')
    head = struct.pack('<BBBBBBBHB', 0xFD, len(payload), 0, 0, 0, system, component, message_id, 0)
    checksum = mavlink.x25crc(head[1:] + payload)
    checksum.accumulate(bytes([mavlink.mavlink_map[message_id].crc_extra]))
    return head + payload + struct.pack('<H', checksum.crc)


def impossible(rng: random.Random) -> bytes:
    """A message with a time that could be now, and nothing else that could be."""
    boot_ms, bad = 100_000 + rng.randrange(20_000), rng.choice([math.nan, math.inf, -math.inf])
    name = rng.choice(['ATTITUDE_QUATERNION', 'LOCAL_POSITION_NED'])
    count = 7 if name == 'ATTITUDE_QUATERNION' else 6
    return frame(name, struct.pack(f'<I{count}f', boot_ms, *[bad] * count), 1, 1)


def hostile(rng: random.Random) -> Iterator[bytes]:
    """Bytes without end: noise, cut, flipped, and whole with contents that cannot be."""
    good = frame('LOCAL_POSITION_NED', struct.pack('<I6f', 100_500, 9, 9, 9, 0, 0, 0), 1, 1)
    while True:
        kind = rng.randrange(8)
        if kind == 0:
            yield rng.randbytes(rng.randrange(1, 60))
        elif kind == 1:
            yield b'\xfd' + rng.randbytes(rng.randrange(1, 60))
        elif kind == 2:
            yield good[: rng.randrange(1, len(good))]
        elif kind == 3:
            flipped = bytearray(good)
            flipped[rng.randrange(1, len(good))] ^= 1 << rng.randrange(8)
            yield bytes(flipped)
        elif kind == 4:
            name, size = rng.choice(NAMES), rng.randrange(1, 60)
            sender = rng.choice([(1, 1), (rng.randrange(256), rng.randrange(256))])
            yield frame(name, rng.randbytes(size), *sender)
        else:
            yield impossible(rng)


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
