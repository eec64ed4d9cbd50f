"""What a user may choose about the reconstruction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ftp_dent_ros.errors import ConfigurationError

UNWRAPPINGS = ('itoh', 'estrada')
#: Usual gain of Estrada's system.
TAU = 0.8
# The options that each method has.
METHODS = {
    'least-squares': (),
    'virtual-reference': ('unwrapping', 'tau'),
    'direct': ('unwrapping', 'tau'),
}


@dataclass(frozen=True)
class Settings:
    """Choices of method and resolution.

    Attributes
    ----------
    method : str
        One of `METHODS`: ``'least-squares'`` fits one model of light, waveform and noise;
        ``'virtual-reference'`` unwraps the phase shift against a virtual reference plane (eq. 12
        and 13 of the paper), ``'direct'`` the fringes' phase itself (eq. 11 of it).
    unwrapping : str, optional
        Of the latter two, one of `UNWRAPPINGS`: Itoh's integration of wrapped differences (the
        default), or Estrada's first-order system, which smooths as it unwraps.
    tau : float, optional
        Gain of Estrada's system, above 0 and up to 1 (0.8): smaller smooths more.
    stride : int
        The cloud has every `stride`-th pixel of the image, along rows and columns.

    Raises
    ------
    ConfigurationError
        A value is none of the choices or out of its range, or an option is not the method's.
    """

    method: str = 'least-squares'
    unwrapping: str | None = None
    tau: float | None = None
    stride: int = 1

    def __post_init__(self) -> None:
        for name, value, choices in (
            ('method', self.method, tuple(METHODS)),
            ('unwrapping', self.unwrapping, (None, *UNWRAPPINGS)),
        ):
            if value not in choices:
                raise ConfigurationError(
                    f'{name} is {value!r}: choose one of {", ".join(filter(None, choices))}'
                )
        tau = self.tau
        if tau is not None and (
            isinstance(tau, bool) or not isinstance(tau, (int, float)) or not 0 < tau <= 1
        ):
            raise ConfigurationError(f'tau is {tau!r}: set it above 0 and up to 1')
        stride = self.stride
        if isinstance(stride, bool) or not isinstance(stride, int) or not 1 <= stride <= 16:
            raise ConfigurationError(f'stride is {stride!r}: set it to a whole number, 1 to 16')
        self._check_options()

    def _check_options(self) -> None:
        """Raise `ConfigurationError` for what the method would ignore."""
        for name in ('unwrapping', 'tau'):
            if getattr(self, name) is not None and name not in METHODS[self.method]:
                others = ', '.join(other for other, names in METHODS.items() if name in names)
                raise ConfigurationError(
                    f'{name} is no option of {self.method}: leave it out, or use it with {others}'
                )
        if self.tau is not None and self.unwrapping != 'estrada':
            raise ConfigurationError(
                'tau is an option of the unwrapping estrada alone: leave it out, or choose that'
            )

    @classmethod
    def chosen(cls, method: str, stride: int = 1, **options: Any) -> Settings:
        """Settings with those of the options that the method has."""
        used = {name: value for name, value in options.items() if name in METHODS.get(method, ())}
        if used.get('unwrapping') != 'estrada':
            used.pop('tau', None)
        return cls(method, stride=stride, **used)
