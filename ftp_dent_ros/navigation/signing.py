"""Messages out of bytes, whatever the bytes are, and bytes out of messages; signed if wanted.

Signing is MAVLink 2's: 6 bytes of SHA-256 over key and packet, and a time that only grows. With a
key set, what is unsigned, wrongly signed or said again is as good as noise.

An autopilot that reboots signs with the time that it saved last, up to 30 s before, until it has
GPS time (ArduPilot). So an autopilot that has been silent for a moment begins anew, as MAVLink has
it for those not heard before: its time may be up to a minute behind. What is said again in that
moment is no danger to a pose: none is given before the vehicle has answered a TIMESYNC sent just
now.
"""

from __future__ import annotations

import hashlib
import hmac
import math
import struct
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import ConfigurationError

# Bytes of a key, as MAVLink 2 signs.
_KEY_LENGTH = 32
# Signatures count units of 10 us since 2015.
_EPOCH_NS, _UNIT_NS = 1_420_070_400 * 10**9, 10_000
_BEGUN_ANEW_NS, _MOST_BEHIND = 10**9, 60 * 10**9 // _UNIT_NS
_SIGNED = mavlink.MAVLINK_IFLAG_SIGNED


def read_key(path: str) -> bytes:
    """Key of 32 bytes from a file that holds them, or their 64 hexadecimal digits.

    Raises
    ------
    ConfigurationError
        The file cannot be read, can be read by others, or holds no key.
    """
    try:
        if Path(path).stat().st_mode & 0o077:
            raise ConfigurationError(f'{path}: others can read the signing key: chmod 600 it')
        content = Path(path).read_bytes()
    except OSError as reason:
        raise ConfigurationError(
            f'{path}: the signing key cannot be read ({reason.strerror}): check signing_key'
        ) from None
    try:
        is_binary = len(content) == _KEY_LENGTH
        key = content if is_binary else bytes.fromhex(content.decode('ascii'))
    except ValueError:
        key = b''
    if len(key) != _KEY_LENGTH:
        raise ConfigurationError(
            f'{path}: holds no signing key: give {_KEY_LENGTH} bytes, or {2 * _KEY_LENGTH} '
            'hexadecimal digits'
        )
    return key


def is_signed(message: Any) -> bool:
    """Whether a message bears a signature, right or wrong."""
    head = message.get_msgbuf()
    return head[0] == mavlink.PROTOCOL_MARKER_V2 and bool(head[2] & _SIGNED)


class _Parser(mavlink.MAVLink):
    """Tells in `why` what was wrong with the last signature.

    `heard` has of each stream the time it was signed with last, and when that was heard.
    """

    def __init__(
        self,
        signing: mavlink.MAVLinkSigning,
        heard: dict[tuple[int, int, int], tuple[int, int]],
        autopilot: int,
    ) -> None:
        super().__init__(None)
        self.robust_parsing, self.signing = True, signing
        self.why, self.now, self._heard, self._autopilot = '', 0, heard, autopilot

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        # Before anything of the packet is believed, its time among it.
        digest = hashlib.sha256(self.signing.secret_key + bytes(msgbuf[:-6])).digest()[:6]
        if not hmac.compare_digest(digest, bytes(msgbuf[-6:])):
            self.why = 'key'
            return False
        stream = (msgbuf[-13], srcSystem, srcComponent)
        time = int.from_bytes(msgbuf[-12:-6], 'little')
        last, heard = self._heard.get(stream, (math.inf, 0))
        is_new = stream not in self._heard
        if srcComponent == self._autopilot:
            is_new = is_new or self.now - heard > _BEGUN_ANEW_NS
        if time <= last and not (is_new and time + _MOST_BEHIND >= self.signing.timestamp):
            self.why = 'time'
            return False
        self._heard[stream] = time, self.now
        self.signing.timestamp = max(self.signing.timestamp, time)
        return True


class Codec:
    """Reads one connection after the other, and writes.

    Parameters
    ----------
    key : bytes
        Of no bytes: none.
    autopilot : int
        The autopilot's component, which may reboot.

    Attributes
    ----------
    bad_bytes : int
        Pieces that were no message.
    refused : int
        Messages without a right signature.
    refusal : tuple
        When the last of them came (UNIX time in ns), and what was wrong with it: '' for no
        signature, 'key' for another key's, 'time' for one of the past.
    """

    def __init__(self, key: bytes = b'', autopilot: int = mavlink.MAV_COMP_ID_AUTOPILOT1) -> None:
        self.bad_bytes = self.refused = 0
        self._autopilot = autopilot
        self.refusal = (0, '')
        self._heard: dict[tuple[int, int, int], tuple[int, int]] = {}
        self._is_whole = False
        self._signing = mavlink.MAVLinkSigning()
        if key:
            self._signing.secret_key = key
            self._signing.sign_outgoing = True
        self._sender = mavlink.MAVLink(None)
        self._sender.signing = self._signing
        self._parser = self._new_parser()

    def restart(self, is_whole: bool) -> None:
        """Begin with a connection; `is_whole` if what comes at once is whole messages."""
        self._is_whole = is_whole
        self._parser = self._new_parser()

    def messages(self, data: bytes, now: int) -> list[Any]:
        """Messages that are complete with these bytes, which came now (UNIX time in ns)."""
        self._set_time(now)
        self._parser.now, self._parser.why = now, ''
        try:
            parsed = self._parser.parse_buffer(data) or []
        except (mavlink.MAVError, ValueError, TypeError, struct.error):
            self.bad_bytes += 1
            self._parser = self._new_parser()
            return []
        messages = []
        for message in parsed:
            if message.get_type() != 'BAD_DATA':
                messages.append(message)
            elif message.reason == 'Invalid signature':
                self.refused += 1
                self.refusal = now, self._parser.why
            else:
                self.bad_bytes += 1
        if self._is_whole and self._parser.buf_len():
            # What one sender cut short must not swallow the next one's message.
            self.bad_bytes += 1
            self._parser = self._new_parser()
        return messages

    def pack(self, message: Any, system: int, component: int, now: int) -> bytes:
        """Bytes of a message from a component, sent now (UNIX time in ns)."""
        self._set_time(now)
        self._sender.srcSystem, self._sender.srcComponent = system, component
        data: bytes = message.pack(self._sender)
        self._sender.seq = (self._sender.seq + 1) % 256
        return data

    def _set_time(self, now: int) -> None:
        if self._signing.secret_key:
            units = max(0, now - _EPOCH_NS) // _UNIT_NS
            self._signing.timestamp = max(self._signing.timestamp, units)

    def _new_parser(self) -> _Parser:
        return _Parser(self._signing, self._heard, self._autopilot)
