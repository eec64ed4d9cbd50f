"""What a user may choose about the inspection."""

from __future__ import annotations

from dataclasses import dataclass

from ftp_dent_ros.errors import ConfigurationError

# Metres: below, nothing is resolved by any camera; beyond, it is no dent or fills the view.
RANGES = {'smallest_depth': (1e-6, 0.1), 'smallest_width': (1e-4, 1.0)}


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
        A value is no number, or outside `RANGES`.
    """

    smallest_depth: float = 1e-4
    smallest_width: float = 0.01

    def __post_init__(self) -> None:
        for name, (least, most) in RANGES.items():
            value = getattr(self, name)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not least <= value <= most:
                raise ConfigurationError(
                    f'{name} is {value!r}: give metres, {least:g} to {most:g}'
                )
