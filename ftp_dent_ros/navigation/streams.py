"""The messages that the autopilot is asked for, and whether they come.

Asked for with MAV_CMD_SET_MESSAGE_INTERVAL, one at a time, for COMMAND_ACK does not say which
message it is about. Any other client of the autopilot may change the rates, and a reboot forgets
them: what comes too slowly is asked for again. Times are steady, in seconds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_ANSWER_TIMEOUT = 0.5
_RETRIES = 3
_WINDOW = 2.0
_PATIENCE = 2.5
_LONGEST_PATIENCE = 8.0
_ENOUGH = 0.8


@dataclass
class Stream:
    """One message that is wanted.

    Attributes
    ----------
    name : str
        MAVLink's name of the message.
    rate : float
        Hz; the autopilot gets the interval in whole milliseconds, as ArduPilot counts.
    required : bool
        Whether it is asked for again after the autopilot has denied it.
    """

    name: str
    rate: float
    required: bool = True
    denied: bool = False
    asked: float | None = None
    patience: float = _PATIENCE
    retries: int = 0
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=4096))

    @property
    def message_id(self) -> int:
        """MAVLink's number of the message."""
        return int(getattr(mavlink, f'MAVLINK_MSG_ID_{self.name}'))

    @property
    def interval_us(self) -> int:
        """Interval to ask for."""
        return max(1, round(1000 / self.rate)) * 1000

    def measured(self, now: float) -> float:
        """Rate over the last seconds, Hz."""
        window = max(_WINDOW, 5 / self.rate)
        while self.arrivals and self.arrivals[0] < now - window:
            self.arrivals.popleft()
        return len(self.arrivals) / window

    def is_due(self, now: float) -> bool:
        """Whether it has to be asked for (again)."""
        if self.asked is None:
            return True
        if self.denied and not self.required:
            return False
        if self.measured(now) >= _ENOUGH * self.rate and not self.denied:
            self.patience = _PATIENCE
            return False
        return now - self.asked > self.patience + max(0.0, 5 / self.rate - _WINDOW)


class Streams:
    """All messages that are wanted of one autopilot."""

    def __init__(self, wanted: Iterable[Stream]) -> None:
        self._streams = {stream.name: stream for stream in wanted}
        self._open: Stream | None = None

    def received(self, name: str, now: float) -> None:
        """Note that a message came."""
        if name in self._streams:
            self._streams[name].arrivals.append(now)

    def acknowledged(self, result: int) -> None:
        """Take the result of the COMMAND_ACK to the last request."""
        if self._open is not None and result != mavlink.MAV_RESULT_IN_PROGRESS:
            self._open.denied = result != mavlink.MAV_RESULT_ACCEPTED
            self._open = None

    def next_request(self, now: float) -> Stream | None:
        """The message to ask for now, if any."""
        unanswered = self._open
        if unanswered is not None and unanswered.asked is not None:
            if now - unanswered.asked < _ANSWER_TIMEOUT:
                return None
            self._open = None
            if unanswered.retries < _RETRIES:
                unanswered.retries += 1
                return self._ask(unanswered, now)
        for stream in self._streams.values():
            if stream.is_due(now):
                if stream.asked is not None:
                    stream.patience = min(2 * stream.patience, _LONGEST_PATIENCE)
                stream.retries = 0
                return self._ask(stream, now)
        return None

    def rates(self, now: float) -> dict[str, float]:
        """Measured rate of each message, Hz."""
        return {name: stream.measured(now) for name, stream in self._streams.items()}

    def asked(self) -> dict[str, float]:
        """Rate that each required message was asked for at, Hz."""
        return {name: s.rate for name, s in self._streams.items() if s.required}

    def denied(self) -> list[str]:
        """Names of the required messages that the autopilot denies."""
        return [s.name for s in self._streams.values() if s.denied and s.required]

    def _ask(self, stream: Stream, now: float) -> Stream:
        stream.asked = now
        self._open = stream
        return stream
