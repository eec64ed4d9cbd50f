"""What is said of the link to people: a sentence and figures."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink


class Verdict(NamedTuple):
    """One sentence on what is wrong, and how bad it is; `reason` has no figures in it."""

    severity: Literal['ok', 'warning', 'error']
    text: str
    reason: str = ''


def number(value: float | None, digits: int, factor: float = 1.0) -> str:
    """A figure with that many digits, times a factor; None and NaN are not known."""
    return 'unknown' if value is None or math.isnan(value) else f'{factor * value:.{digits}f}'


def enum_name(enumeration: str, value: int) -> str:
    """What MAVLink calls a value, in small letters."""
    entry = mavlink.enums[enumeration].get(value)
    if entry is None:
        return f'type {value}'
    return str(entry.name).removeprefix(f'{enumeration}_').replace('_', ' ').lower()
