"""What is known of the autopilot and of the link, for those who watch."""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.navigation.clock import ClockState
from ftp_dent_ros.navigation.origin import Origin
from ftp_dent_ros.navigation.trust import GpsState

# An autopilot heartbeats at 1 Hz whatever else it sends; diagnostics tell it a second later.
SILENCE = 1.5

# A link with more speakers is one on which somebody makes them up.
_MOST = 64


@dataclass(frozen=True)
class VehicleState:
    """State for those who watch; counts are since the start, times in seconds, rates in Hz.

    Attributes
    ----------
    silence : float or None
        Time since the autopilot was last heard.
    estimator : str
        As `Estimator.state`.
    estimator_fault : str
        What is wrong with it by its latest report, '' if nothing is.
    gps : GpsState or None
        None if the vehicle does not navigate by GPS.
    above_ground : float or None
        Distance to what a range finder sees below, metres.
    utc_error : float or None
        How far this computer's clock is ahead of the autopilot's UTC (of GPS), if it has one.
    rates : dict
        Rates measured, by the messages' names.
    slow, denied : list
        Names of the required messages that come too slowly, and that are denied.
    rerated : int
        How often somebody else changed the rate of a message that is wanted.
    rerated_by : str
        Who was last seen to, if that was of late; 'another client' if nobody was seen.
    foreign, malformed, lost : int
        Messages of others; of the autopilot's own with impossible contents; that never came.
    resets : int
        Jumps of the estimator.
    pose_age : float or None
        Age of the newest sample of a pose.
    origin : Origin or None
        Where on the earth the map's origin is, if that was asked and is known.
    origin_error : float or None
        How far apart two ways to know it are, metres.
    """

    identity: tuple[int, int] | None
    autopilot: str
    silence: float | None
    estimator: str
    clock: ClockState
    utc_error: float | None
    rates: dict[str, float]
    slow: list[str]
    denied: list[str]
    messages: int
    foreign: int
    malformed: int
    lost: int
    resets: int
    estimator_fault: str = ''
    gps: GpsState | None = None
    above_ground: float | None = None
    rerated: int = 0
    rerated_by: str = ''
    pose_age: float | None = None
    origin: Origin | None = None
    origin_error: float | None = None

    @property
    def is_alive(self) -> bool:
        """Whether the autopilot has been heard of late."""
        return self.silence is not None and self.silence < SILENCE


@dataclass(frozen=True)
class LinkState:
    """State of the connection and of the vehicle behind it.

    Attributes
    ----------
    fault : str
        Why the connection is not open; '' if it is.
    vehicle : VehicleState
        What is known of the autopilot.
    bad_bytes : int
        Pieces that were no MAVLink message.
    reconnections : int
        How often the connection was opened again.
    refused : int
        Messages without the signature that was wanted.
    refusal : str or None
        What was wrong with one of the last seconds: '' for no signature, 'key' for another key's,
        'time' for one of the past.
    is_signing : bool
        Whether the vehicle signs what it says, and nothing is signed here.
    impostors : int
        Messages in the vehicle's name from another address than its own.
    """

    fault: str
    vehicle: VehicleState
    bad_bytes: int
    reconnections: int
    refused: int = 0
    impostors: int = 0
    refusal: str | None = None
    is_signing: bool = False


@dataclass
class Speaker:
    """One component on the link.

    Attributes
    ----------
    system, component : int
    kind : str
        What its heartbeat says that it is; '' before the first.
    autopilot : str
        Its firmware, if it is an autopilot; else ''.
    counts : Counter
        How many of each message it sent.
    first, last : dict
        When each was heard, seconds of steady time.
    """

    system: int
    component: int
    kind: str = ''
    autopilot: str = ''
    counts: Counter[str] = field(default_factory=Counter)
    first: dict[str, float] = field(default_factory=dict)
    last: dict[str, float] = field(default_factory=dict)

    def rate(self, name: str) -> float:
        """Mean rate of a message between the first and the last that was heard, Hz."""
        seconds = self.last[name] - self.first[name]
        return (self.counts[name] - 1) / seconds if seconds > 0 else 0.0


class Roster:
    """All who were heard."""

    def __init__(self) -> None:
        self._speakers: dict[tuple[int, int], Speaker] = {}

    def hear(self, message: Any, now: float) -> None:
        """Note a message that came at a steady time."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        speaker = self._speakers.get(source)
        if speaker is None:
            # Messages that the dialect does not know are of nobody.
            if source[0] == 0 or len(self._speakers) >= _MOST:
                return
            speaker = self._speakers[source] = Speaker(*source)
        name = message.get_type()
        speaker.counts[name] += 1
        speaker.first.setdefault(name, now)
        speaker.last[name] = now
        if name == 'HEARTBEAT':
            speaker.kind = _name('MAV_TYPE', message.type)
            is_autopilot = message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
            speaker.autopilot = _name('MAV_AUTOPILOT', message.autopilot) if is_autopilot else ''

    def speakers(self) -> list[Speaker]:
        """Who was heard, by system and component."""
        return [copy.deepcopy(speaker) for _, speaker in sorted(self._speakers.items())]


def _name(enumeration: str, value: int) -> str:
    """What MAVLink calls a value, in small letters."""
    entry = mavlink.enums[enumeration].get(value)
    if entry is None:
        return f'type {value}'
    return str(entry.name)[len(enumeration) + 1 :].replace('_', ' ').lower()
