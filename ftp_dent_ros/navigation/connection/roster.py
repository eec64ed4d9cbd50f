"""Who speaks on a link, and what."""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

# A link with more speakers is one on which somebody makes them up.
_MOST = 64


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
