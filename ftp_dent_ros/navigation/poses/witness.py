"""Reports that carry no time of their own, and what they vouch for.

What a report says holds from the one before it: a moment is vouched for by two good reports on
either side of it that lie near enough to each other. So whatever fails is refused from the last
good report on, not from when the failure shows.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from ftp_dent_ros.errors import PoseAwaitedError, PoseError

_SECOND = 1_000_000_000
# Reports that a time in the past may still be held against.
_KEPT = 256


@dataclass(frozen=True)
class Fault:
    """Why a report vouches for nothing: a sentence, and the few fixed words it is counted by."""

    sentence: str
    reason: str


class Report(Protocol):
    """A report; without a fault it is good."""

    @property
    def fault(self) -> Fault | None:
        """What is wrong with it."""


R = TypeVar('R', bound=Report)


class Witness(Generic[R]):
    """Reports of one kind; times are ROS times of arrival in nanoseconds.

    Parameters
    ----------
    what : str
        What is reported, as the object of 'has not reported'.
    name : str
        The same in a word or two, for the reasons of refusals.
    longest : float
        Reports further apart vouch for nothing between them, seconds.
    """

    def __init__(self, what: str, name: str, longest: float) -> None:
        self._what, self._name = what, name
        self._longest = round(longest * _SECOND)
        self._reports: deque[tuple[int, R]] = deque(maxlen=_KEPT)
        self._since: int | None = None

    def restart(self, now: int) -> None:
        """Forget all reports: the autopilot has just been found, or has rebooted."""
        self._reports.clear()
        self._since = now

    def add(self, report: R, now: int) -> None:
        """Take a report that arrived now."""
        self._reports.append((now, report))

    @property
    def last(self) -> R | None:
        """The latest report."""
        return self._reports[-1][1] if self._reports else None

    def age(self, now: int) -> float | None:
        """Seconds since the latest report."""
        return (now - self._reports[-1][0]) / _SECOND if self._reports else None

    def is_awaited(self, now: int) -> bool:
        """Whether none has come, but it is too early to say that none will."""
        return not self._reports and (self._since is None or now - self._since < self._longest)

    def is_silent(self, now: int) -> bool:
        """Whether too much time has passed since the latest report."""
        return bool(self._reports) and now - self._reports[-1][0] > self._longest

    def around(self, stamp: int, heard: int) -> tuple[R, R]:
        """The good reports before and after a stamp.

        `heard` is when the autopilot was last heard at all: silence of the whole link is not
        silence about this.

        Raises
        ------
        PoseAwaitedError
            The report after the stamp is still to come.
        PoseError
            One of them is bad, or too long did not come.
        """
        if self.is_awaited(heard):
            raise PoseAwaitedError(
                f'the autopilot has not reported {self._what} yet', f'{self._name} report awaited'
            )
        if not self._reports:
            raise PoseError(
                f'the autopilot does not report {self._what}', f'{self._name} not reported'
            )
        before: tuple[int, R] | None = None
        after: tuple[int, R] | None = None
        for entry in reversed(self._reports):
            if entry[0] <= stamp:
                before = entry
                break
            after = entry
        for entry in filter(None, (before, after)):
            fault = entry[1].fault
            if fault is not None:
                raise PoseError(fault.sentence, fault.reason)
        if before is None:
            raise PoseError(
                f'the autopilot had not reported {self._what} by that time',
                f'{self._name} not reported',
            )
        if (after[0] if after else heard) - before[0] > self._longest:
            raise PoseError(
                f'the autopilot did not report {self._what} around that time',
                f'{self._name} not reported',
            )
        if after is None:
            raise PoseAwaitedError(
                f'the autopilot has not reported {self._what} since the stamp',
                f'{self._name} report awaited',
            )
        return before[1], after[1]
