"""What of the lit skin has points, and why the rest has none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

# Share of the lit area that may be left out without a remark.
_REMARKABLE = 0.02
#: Share of white that 14 bits in 16 do not pass.
DIM = 0.25

CLIPPED = 'clipped'
UNTIED = 'not tied to the red stripe'
UNNUMBERED = 'not numbered by the code'
UNEXPLAINED = 'not explained by the fringes'

_SENTENCES = {
    CLIPPED: 'is clipped: expose for a shorter time, or turn away from the highlight',
    UNTIED: (
        'is not tied to the red stripe (a step or a gap lies between): bring the stripe onto it '
        'to measure it'
    ),
    UNNUMBERED: (
        'shows too few whole fringes side by side to tell which they are: come closer, or bring '
        'more of that surface into view'
    ),
    UNEXPLAINED: 'does not look like the fringes (edges, dirt, reflections, other light)',
}
_UNCONFIRMED = (
    "no rim of the projector's frame that would tell is seen in its place, left or right: whether "
    'the pattern is the one given could not be checked'
)
REASONS = tuple(_SENTENCES)
#: Name, in diagnostics, of the stamp (ns) of the cloud that the shares beside it are of.
NOTED_STAMP = 'lit area at (ns)'
# Names of shares among the values of diagnostics.
_WITH, _WITHOUT = 'lit area with points', 'lit but '


@dataclass(frozen=True)
class Coverage:
    """Shares of the lit area.

    Attributes
    ----------
    missing : mapping
        By reason, one of this module's: the share of the lit area, but for its rim, without
        points for it, 0 to 1.
    confirmed : bool
        Whether the photograph itself shows that the pattern is the one given.
    brightest : float
        The photograph's highest level as a share of white.
    """

    missing: Mapping[str, float] = field(default_factory=dict)
    confirmed: bool = True
    brightest: float = 1.0

    @classmethod
    def of(
        cls, lit: NDArray[np.bool_], measured: NDArray[np.bool_], **reasons: NDArray[np.bool_]
    ) -> Coverage:
        """Coverage by masks of one shape; of several reasons for a place the first counts.

        Parameters
        ----------
        lit, measured : ndarray, bool
        **reasons : ndarray, bool
            By the name of a reason of this module, where it holds.
        """
        total = max(int(np.count_nonzero(lit)), 1)
        left, missing = lit & ~measured, {}
        for name, mask in reasons.items():
            reason = globals()[name.upper()]
            missing[reason] = float(np.count_nonzero(left & mask) / total)
            left = left & ~mask
        missing[UNEXPLAINED] = float(np.count_nonzero(left) / total)
        return cls({reason: share for reason, share in missing.items() if share})

    @classmethod
    def noted(cls, values: Mapping[str, str]) -> Coverage | None:
        """Coverage that `notes` has written, to a tenth of a percent; None if there is none."""
        if _WITH not in values:
            return None
        try:
            shares = {
                reason: float(values[f'{_WITHOUT}{reason}'].rstrip('%')) / 100
                for reason in REASONS
                if f'{_WITHOUT}{reason}' in values
            }
        except ValueError:
            return None
        return cls({reason: share for reason, share in shares.items() if 0 < share <= 1})

    @property
    def notes(self) -> dict[str, str]:
        """The shares for people, by name, as diagnostics show them."""
        missing = {
            f'{_WITHOUT}{reason}': f'{self.missing.get(reason, 0):.1%}' for reason in REASONS
        }
        return {_WITH: f'{self.share:.1%}', **missing, 'remarks': '; '.join(self.remarks)}

    @property
    def share(self) -> float:
        """Share of the lit area with points, 0 to 1."""
        return 1 - sum(self.missing.values())

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was left out, and why, and what could not be checked: a sentence each."""
        words = [
            f'{share:.0%} of the lit area {_SENTENCES[reason]}'
            for reason, share in sorted(self.missing.items(), key=lambda item: -item[1])
            if share > _REMARKABLE
        ]
        if self.brightest < DIM:
            words.append(
                f'no level is above {self.brightest:.1%} of white, so that what is dimly lit has '
                'no points: expose longer, or, if the camera has fewer bits, tell how many (bits, '
                '--encoding)'
            )
        if not self.confirmed:
            words.append(_UNCONFIRMED)
        return tuple(words)
