"""Bytes of every kind, and signatures."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.navigation.signing import Codec, read_key

KEY = bytes(range(32))
NOW = time.time_ns()
BEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)


def whole(key: bytes = b'') -> Codec:
    codec = Codec(key)
    codec.restart(True)
    return codec


def signed(key: bytes = KEY, at: int = NOW, system: int = 1) -> bytes:
    return Codec(key).pack(BEAT, system, 1, at)


def types(codec: Codec, data: bytes, now: int = NOW) -> list[str]:
    return [message.get_type() for message in codec.messages(data, now)]


def test_a_stream_is_put_together_and_a_datagram_cut_short_does_not_swallow_the_next() -> None:
    datagrams, stream, data = whole(), Codec(), Codec().pack(BEAT, 1, 1, NOW)
    for codec in (datagrams, stream):
        assert types(codec, data[:9]) == []
    assert types(datagrams, data) == ['HEARTBEAT']
    assert (datagrams.bad_bytes, stream.bad_bytes) == (1, 0)
    assert types(stream, data[9:] + data[:5]) == ['HEARTBEAT']
    assert types(stream, data[5:]) == ['HEARTBEAT']


def test_with_a_key_only_what_is_signed_with_it_is_taken() -> None:
    codec = whole(KEY)
    assert types(codec, signed()) == ['HEARTBEAT']
    assert types(codec, Codec().pack(BEAT, 1, 1, NOW)) == []
    assert types(codec, signed(bytes(32))) == []
    broken = bytearray(signed(at=NOW + 10**9))
    broken[-1] ^= 1
    assert types(codec, bytes(broken)) == []
    assert codec.refused == 3
    assert codec.bad_bytes == 0
    # A forged time does not shut out the true one.
    assert types(codec, signed(bytes(32), NOW + 3600 * 10**9)) == []
    # What follows in the datagram, cut short, does not hide why.
    assert types(codec, signed(bytes(32)) + b'\xfd') == []
    assert codec.refusal == (NOW, 'key')
    assert types(codec, signed(at=NOW + 2 * 10**9)) == ['HEARTBEAT']


def test_what_was_said_before_is_refused() -> None:
    codec, data = whole(KEY), signed()
    assert types(codec, data) == ['HEARTBEAT']
    assert types(codec, data) == []
    assert types(codec, signed(at=NOW - 5 * 10**9)) == []
    # Of a speaker who is new: no older than a minute.
    assert types(codec, signed(at=NOW - 50 * 10**9, system=2)) == ['HEARTBEAT']
    assert types(codec, signed(at=NOW - 70 * 10**9, system=3)) == []


def test_an_autopilot_that_was_silent_may_begin_anew_and_nobody_else() -> None:
    codec, station = whole(KEY), Codec(KEY).pack(BEAT, 255, 190, NOW)
    assert types(codec, signed()) == types(codec, station) == ['HEARTBEAT']
    rebooted, again = signed(at=NOW - 25 * 10**9), Codec(KEY).pack(BEAT, 255, 190, NOW - 10**9)
    assert types(codec, rebooted, NOW + 9 * 10**8) == []  # it has just spoken
    later = NOW + 2 * 10**9
    assert types(codec, rebooted, later) == ['HEARTBEAT']
    assert types(codec, rebooted, later) == []
    assert types(codec, again, later) == []
    assert codec.refusal == (later, 'time')
    assert types(codec, signed(at=NOW - 70 * 10**9), later + 2 * 10**9) == []


def key_file(folder: Path, content: bytes, mode: int = 0o600) -> str:
    path = folder / 'key'
    path.write_bytes(content)
    path.chmod(mode)
    return str(path)


def test_a_key_is_read_as_bytes_or_digits_and_nothing_else(tmp_path: Path) -> None:
    for content in (KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b'\n'):
        assert read_key(key_file(tmp_path, content)) == KEY
    for content in (b'', b'short', KEY + b'1', 64 * b'g', 66 * b'0'):
        with pytest.raises(ConfigurationError, match='holds no signing key'):
            read_key(key_file(tmp_path, content))
    with pytest.raises(ConfigurationError, match='chmod 600'):
        read_key(key_file(tmp_path, KEY, 0o644))
    with pytest.raises(ConfigurationError, match='cannot be read'):
        read_key(str(tmp_path / 'none'))
