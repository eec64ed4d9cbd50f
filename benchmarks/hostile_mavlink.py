"""Bytes on a MAVLink link that mean no good."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

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
