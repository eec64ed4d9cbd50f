"""Who else sets the rates of an autopilot's messages, as far as that is heard on the link.

Routers and many autopilots forward other clients' commands and the answers to them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
_COMMANDS = ('COMMAND_LONG', 'COMMAND_INT')


@dataclass(frozen=True)
class Meddling:
    """A change of rates.

    Attributes
    ----------
    who : str
        System and component, and the message that says so.
    message_id : int or None
        The message whose rate was set; None if that may be any.
    """

    who: str
    message_id: int | None


def meddler(message: Any, vehicle: tuple[int, int], our_system: int) -> Meddling | None:
    """Who changes rates by a message; None if nobody does, or we do.

    `vehicle` is system and component of the autopilot; we are the onboard computer of its system.
    """
    name, source = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
    ours = (our_system, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    if name == 'COMMAND_ACK':
        target = (message.target_system, message.target_component)
        if source == vehicle and message.command == _INTERVAL and target not in (ours, (0, 0)):
            return Meddling(f'{target[0]}/{target[1]} (answered SET_MESSAGE_INTERVAL)', None)
        return None
    if name not in (*_COMMANDS, 'REQUEST_DATA_STREAM') or source in (ours, vehicle):
        return None
    if message.target_system not in (0, vehicle[0]):
        return None
    if name == 'REQUEST_DATA_STREAM':
        return Meddling(f'{source[0]}/{source[1]} (REQUEST_DATA_STREAM)', None)
    if message.command != _INTERVAL or not 0 <= message.param1 < 2**24:
        return None
    return Meddling(f'{source[0]}/{source[1]} (SET_MESSAGE_INTERVAL)', int(message.param1))
