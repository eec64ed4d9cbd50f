"""What a user may choose about the inspection."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ftp_dent_ros.errors import ConfigurationError


@dataclass(frozen=True)
class Settings:
    """The smallest dent that is looked for.

    Attributes
    ----------
    smallest_depth : float
        Shallower ones are not reported, however significant, metres; of those that the rim cuts,
        four times that, and eight times of those that lie along it.
    smallest_width : float
        Of the 10 % contour: narrower ones are rivets, scratches and gaps; metres.

    Raises
    ------
    ConfigurationError
        A value is not a positive number.
    """

    smallest_depth: float = 1e-4
    smallest_width: float = 0.01

    def __post_init__(self) -> None:
        for name in ('smallest_depth', 'smallest_width'):
            value = getattr(self, name)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not 0 < value < math.inf:
                raise ConfigurationError(f'{name} is {value!r}: give metres, above 0')
