"""What is known of a connection."""

from __future__ import annotations

from dataclasses import dataclass

from ftp_dent_ros.navigation.autopilot.vehicle_state import VehicleState


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
