"""Which way the vehicle's messages come, and what comes in its name another way."""

from __future__ import annotations

from typing import Any

from ftp_dent_ros.navigation.connection.transport import Peer

# A vehicle that is heard from another address has been silent for as long, or is none; seconds.
_MOVING_TIME = 1.0


class Way:
    """The address from which the vehicle speaks.

    Attributes
    ----------
    peer : tuple or None
        That address, where there is a choice.
    impostors : int
        Messages in the vehicle's name from elsewhere.
    """

    def __init__(self) -> None:
        self.impostors = 0
        self.restart()

    def restart(self) -> None:
        """A connection begins, or has ended."""
        self.peer: Peer = None
        self._heard = 0.0

    def confirm(self, peer: Peer, now: float) -> None:
        """The vehicle has spoken from there at a steady time."""
        self.peer, self._heard = peer, now

    def is_elsewhere(
        self, message: Any, vehicle: tuple[int, int] | None, peer: Peer, now: float
    ) -> bool:
        """Whether it speaks in the vehicle's name from elsewhere while that goes on speaking.

        After a reboot the vehicle may come back from another port, but not at once.
        """
        source = (message.get_srcSystem(), message.get_srcComponent())
        is_other = source == vehicle and self.peer is not None and peer != self.peer
        if not is_other or now - self._heard >= _MOVING_TIME:
            return False
        self.impostors += 1
        return True

    def is_for_us(self, command: Any, vehicle: tuple[int, int] | None, peer: Peer) -> bool:
        """Whether a command came the vehicle's way, to its system or from the autopilot to all."""
        if vehicle is None or peer != self.peer:
            return False
        source = (command.get_srcSystem(), command.get_srcComponent())
        to_all = command.target_system == 0 and source == vehicle
        return to_all or command.target_system == vehicle[0]
