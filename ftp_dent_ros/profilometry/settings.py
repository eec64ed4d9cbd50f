"""What a user may choose about the reconstruction."""

from __future__ import annotations

from dataclasses import dataclass

from ftp_dent_ros.errors import ConfigurationError

METHODS = ('least-squares', 'virtual-reference', 'direct')
UNWRAPPINGS = ('itoh', 'estrada')


@dataclass(frozen=True)
class Settings:
    """Choices of method and resolution.

    Attributes
    ----------
    method : str
        One of `METHODS`: ``'least-squares'`` fits the fringes in windows about the analytic
        reference phase; ``'virtual-reference'`` unwraps the phase shift against a virtual
        reference plane (eq. 12 and 13), ``'direct'`` the fringes' phase itself (eq. 11).
    unwrapping : str
        One of `UNWRAPPINGS`: Itoh's integration of wrapped differences, or Estrada's
        first-order system, which smooths as it unwraps.
    tau : float
        Gain of Estrada's system, above 0 and up to 1: smaller smooths more.
    stride : int
        The cloud has every `stride`-th pixel of the image, along rows and columns.
    fast : bool
        Whether least squares correct their model once instead of twice.

    Raises
    ------
    ConfigurationError
        A value is none of the choices or out of its range.
    """

    method: str = 'least-squares'
    unwrapping: str = 'itoh'
    tau: float = 0.8
    stride: int = 1
    fast: bool = False

    def __post_init__(self) -> None:
        for name, value, choices in (
            ('method', self.method, METHODS),
            ('unwrapping', self.unwrapping, UNWRAPPINGS),
        ):
            if value not in choices:
                raise ConfigurationError(
                    f'{name} is {value!r}: choose one of {", ".join(choices)}'
                )
        tau = self.tau
        if isinstance(tau, bool) or not isinstance(tau, (int, float)) or not 0 < tau <= 1:
            raise ConfigurationError(f'tau is {tau!r}: set it above 0 and up to 1')
        stride = self.stride
        if isinstance(stride, bool) or not isinstance(stride, int) or not 1 <= stride <= 16:
            raise ConfigurationError(f'stride is {stride!r}: set it to a whole number, 1 to 16')
        if not isinstance(self.fast, bool):
            raise ConfigurationError(f'fast is {self.fast!r}: set it to true or false')
