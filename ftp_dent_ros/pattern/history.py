"""Which pattern the projector showed at the time of a photograph.

Patterns and photographs reach a node by different ways, in any order and late by any time; their
stamps alone say what belongs together.
"""

from __future__ import annotations

import bisect
import threading

from ftp_dent_ros.errors import NoPatternError, PatternChangeError
from ftp_dent_ros.pattern.pattern import Pattern

# Patterns that are remembered: far more than change while a photograph is on its way.
_MOST = 64
_NOTHING_CAME = 'nothing came on the pattern topic yet: start pattern_publisher'


class PatternHistory:
    """Patterns with the times from which on they were shown; any thread may ask.

    Parameters
    ----------
    settling_ns : int
        Around a change it is not known for so many nanoseconds, before and after, what is seen.
    """

    def __init__(self, settling_ns: int) -> None:
        self.settling_ns = settling_ns
        self.trouble = _NOTHING_CAME
        self._shown: list[tuple[int, Pattern]] = []
        self._lock = threading.Lock()

    @property
    def latest(self) -> Pattern | None:
        """Pattern of the latest stamp, if one is known."""
        with self._lock:
            return self._shown[-1][1] if self._shown else None

    def add(self, stamp_ns: int, pattern: Pattern) -> None:
        """Remember that `pattern` is shown from a time on, in whatever order they come."""
        with self._lock:
            self.trouble = ''
            others = [entry for entry in self._shown if entry[0] != stamp_ns]
            bisect.insort(others, (stamp_ns, pattern), key=_stamp)
            self._shown = others[-_MOST:]

    def forget(self, trouble: str) -> None:
        """Forget the patterns: what is shown is not known any more, and `trouble` says why."""
        with self._lock:
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
        with self._lock:
            shown, trouble = self._shown, self.trouble
        if not shown:
            raise NoPatternError(trouble)
        if stamp_ns == 0:
            raise NoPatternError(
                'the photograph has no stamp, so that it is not known which pattern it shows: '
                'stamp it with the middle of its exposure'
            )
        if stamp_ns < shown[0][0]:
            raise NoPatternError(
                f'the photograph is {(shown[0][0] - stamp_ns) / 1e9:.3f} s older than the oldest '
                'pattern that is known: replay a bag with its pattern, or set the clocks of the '
                'camera and of pattern_publisher alike'
            )
        for change in range(len(shown)):
            away_ns = stamp_ns - shown[change][0]
            if abs(away_ns) >= self.settling_ns:
                continue
            old = shown[change - 1][1] if change else None
            if old != shown[change][1]:
                raise PatternChangeError(
                    f'the photograph was taken {abs(away_ns) / 1e6:.0f} ms '
                    f'{"before" if away_ns < 0 else "after"} {_told(old, shown[change][1])}, and '
                    f'within {self.settling_ns / 1e6:.0f} ms of that it may show either: '
                    'take photographs later'
                )
        return shown[bisect.bisect_right(shown, stamp_ns, key=_stamp) - 1][1]


def _stamp(entry: tuple[int, Pattern]) -> int:
    return entry[0]


def _told(old: Pattern | None, new: Pattern) -> str:
    """What changed between two patterns, with the numbers of both."""
    if old is None:
        return 'the first pattern that is known'
    if old.period_px != new.period_px:
        return f'the period changed from {old.period_px:g} to {new.period_px:g} px'
    if old.stripe_center_px != new.stripe_center_px:
        return f'the stripe moved from {old.stripe_center_px:g} to {new.stripe_center_px:g} px'
    if (old.code, old.low_contrast) != (new.code, new.low_contrast):
        return f'the code changed from {_coded(old)} to {_coded(new)}'
    return f'the size changed from {old.width}x{old.height} to {new.width}x{new.height} px'


def _coded(pattern: Pattern) -> str:
    return f'{pattern.code} {pattern.low_contrast:g}' if pattern.code == 'contrast' else 'a stripe'
