"""Which pattern the projector showed at the time of a photograph.

Patterns and photographs reach a node by different ways, in any order and late by any time; their
stamps alone say what belongs together. Where the computer's clock steps, the stamps of before are
taken for what they would be by the clock of now.
"""

from __future__ import annotations

import bisect
import time
from collections.abc import Callable

from ftp_dent_ros.errors import NoPatternError, PatternChangeError
from ftp_dent_ros.pattern.pattern import Pattern


class PatternHistory:
    """Patterns with the times from which on they were shown; any thread may ask, one adds.

    Parameters
    ----------
    settling_ns : int
        Around a change it is not known for so many nanoseconds, before and after, what is shown.
    clock_offset : callable
        How far the clock of the stamps is ahead of a steady one, nanoseconds.
    """

    def __init__(
        self,
        settling_ns: int,
        clock_offset: Callable[[], int] = lambda: time.time_ns() - time.monotonic_ns(),
    ) -> None:
        self.settling_ns = settling_ns
        self._clock_offset, self._offset_ns = clock_offset, clock_offset()
        self.trouble = 'nothing came on the pattern topic yet: start pattern_publisher'
        # By steady time; the stamp as it was given tells a repeated message.
        self._shown: list[tuple[int, int, Pattern]] = []  # never changed, only replaced

    @property
    def latest(self) -> Pattern | None:
        """Pattern of the latest stamp, if one is known."""
        shown = self._shown
        return shown[-1][2] if shown else None

    def add(self, stamp_ns: int, pattern: Pattern) -> None:
        """Remember that `pattern` is shown from a time on, in whatever order they come."""
        others = [entry for entry in self._shown if entry[1] != stamp_ns]
        bisect.insort(others, (self._steady(stamp_ns), stamp_ns, pattern), key=_time)
        # Far more than change while a photograph is on its way.
        self._shown = others[-64:]
        self.trouble = ''

    def forget(self, trouble: str) -> None:
        """Forget the patterns: what is shown is not known any more, and `trouble` says why."""
        self.trouble = trouble
        self._shown = []

    def at(self, stamp_ns: int) -> Pattern:
        """Pattern that a photograph shows.

        Parameters
        ----------
        stamp_ns : int
            Middle of its exposure, nanoseconds.

        Raises
        ------
        NoPatternError
            No pattern is known, or none that is as old as the photograph.
        PatternChangeError
            The photograph was taken while the pattern changed.
        """
        shown = self._shown
        if not shown:
            raise NoPatternError(self.trouble)
        if stamp_ns == 0:
            raise NoPatternError(
                'the photograph has no stamp, so that it is not known which pattern it shows: '
                'stamp it with the middle of its exposure'
            )
        time_ns = self._steady(stamp_ns)
        if time_ns < shown[0][0]:
            raise NoPatternError(
                f'the photograph is {(shown[0][0] - time_ns) / 1e9:.3f} s older than the oldest '
                'pattern that is known: replay a bag with its pattern, or set the clocks of the '
                'camera and of pattern_publisher alike'
            )
        for change in range(len(shown)):
            away_ns = time_ns - shown[change][0]
            old = shown[change - 1][2] if change else None
            if abs(away_ns) < self.settling_ns and old != shown[change][2]:
                side = 'before' if away_ns < 0 else 'after'
                raise PatternChangeError(
                    f'the photograph was taken {abs(away_ns) / 1e6:.0f} ms '
                    f'{side} {_described(old, shown[change][2])}, and '
                    f'within {self.settling_ns / 1e6:.0f} ms of that it may show either: '
                    'take photographs later'
                )
        return shown[bisect.bisect_right(shown, time_ns, key=_time) - 1][2]

    def _steady(self, stamp_ns: int) -> int:
        """A stamp of now by the steady clock; what clocks drift by is no step."""
        offset_ns = self._clock_offset()
        if abs(offset_ns - self._offset_ns) > 100_000_000:
            self._offset_ns = offset_ns
        return stamp_ns - self._offset_ns


def _time(entry: tuple[int, int, Pattern]) -> int:
    return entry[0]


def _described(old: Pattern | None, new: Pattern) -> str:
    """What changed between two patterns."""
    if old is None:
        return 'the first pattern that is known'
    if old.period_px != new.period_px:
        return f'the period changed from {old.period_px:g} to {new.period_px:g} px'
    return 'the pattern changed'
