"""Shapes of dents, as functions over the unit disc or square: 1 in the middle, 0 at the border.

A shape knows no size. ``fraction(u, v)`` is the part of the depth at normalised coordinates along
the length and the width, with its derivatives; beyond ``border`` from the middle it is 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError

# exp(1 - 1/q) is below 1e-300 here, and its slope does not overflow.
_RIM = 1.4e-3

Field = NDArray[np.float64]


class Shape(Protocol):
    """What a dent's height is, as a part of its depth; equal if it is the same."""

    def __hash__(self) -> int: ...

    @property
    def kind(self) -> str:
        """What an inspector calls it: ``'dent'``, ``'crease'`` or ``'gouge'``."""

    @property
    def border(self) -> float:
        """Distance from the middle beyond which it is 0."""

    def fraction(self, u: Field, v: Field) -> tuple[Field, Field, Field]:
        """Part of the depth, and its derivatives along `u` and `v`."""


class _Radial:
    """A shape that depends on the distance r from the middle alone, through ``r^2``."""

    kind = 'dent'
    border = 1.0

    def fraction(self, u: Field, v: Field) -> tuple[Field, Field, Field]:
        """Part of the depth, and its derivatives along `u` and `v`."""
        value, slope = self.profile(u * u + v * v)
        return value, 2 * u * slope, 2 * v * slope

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        raise NotImplementedError


@dataclass(frozen=True)
class Smooth(_Radial):
    """Eq. 18, over its maximum: ``exp(1 - 1 / (1 - r^2))``."""

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        q = np.maximum(1 - square, _RIM)
        value = np.where(q > _RIM, np.exp(1 - 1 / q), 0.0)
        return value, -value / (q * q)


@dataclass(frozen=True)
class RaisedCosine(_Radial):
    """``(1 + cos(pi r)) / 2``."""

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        r = np.sqrt(np.minimum(square, 1))
        return (1 + np.cos(math.pi * r)) / 2, -(math.pi**2) / 4 * np.sinc(r)


@dataclass(frozen=True)
class Gaussian(_Radial):
    """``10^(-r^2)``, as hail leaves: without a border, its axes are those at 10 % of the depth."""

    border = 3.0

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        value = np.where(square < self.border**2, np.exp(-math.log(10) * square), 0.0)
        return value, -math.log(10) * value


@dataclass(frozen=True)
class Cap(_Radial):
    """A paraboloid ``1 - r^2``: a sphere's cap of a dent's shallowness, its rim a kink."""

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        return np.maximum(1 - square, 0), np.where(square < 1, -1.0, 0.0)


@dataclass(frozen=True)
class Plate(_Radial):
    """``(1 - r^2)^2``, a clamped plate under even load: an oil can, large and soft."""

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        q = np.maximum(1 - square, 0)
        return q * q, -2 * q


@dataclass(frozen=True)
class FlatBottomed(_Radial):
    """A flat bottom up to ``r = bottom``, then half a cosine up to the border."""

    bottom: float = 0.5

    def __post_init__(self) -> None:
        if not 0 <= self.bottom < 1:
            raise ConfigurationError(
                f'the bottom of a dent is {self.bottom!r}: give its part of the axes, 0 to below 1'
            )

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        r = np.sqrt(np.minimum(square, 1))
        angle = math.pi * np.maximum(r - self.bottom, 0) / (1 - self.bottom)
        slope = -math.pi / 2 * np.sin(angle) / (1 - self.bottom)
        return (1 + np.cos(angle)) / 2, slope / (2 * np.maximum(r, 1e-9))


@dataclass(frozen=True)
class Crater(_Radial):
    """A hole with a raised rim: half a cosine down from the rim's crest, another one outside.

    Attributes
    ----------
    rim : float
        Height of the rim over the skin, as a part of the depth below it.
    crest : float
        Where the rim is highest, as a part of the axes.
    """

    rim: float = 0.2
    crest: float = 0.7

    def __post_init__(self) -> None:
        if not (0 <= self.rim <= 1 and 0 < self.crest < 1):
            raise ConfigurationError(
                f'a crater has a rim of {self.rim!r} with its crest at {self.crest!r}: '
                'give parts of the depth and of the axes'
            )

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        r = np.sqrt(np.minimum(square, 1))
        inside = r < self.crest
        angle = math.pi * np.where(inside, r / self.crest, (r - self.crest) / (1 - self.crest))
        value = np.where(
            inside,
            (1 - self.rim + (1 + self.rim) * np.cos(angle)) / 2,
            -self.rim * (1 + np.cos(angle)) / 2,
        )
        steepness = np.where(inside, -(1 + self.rim) / self.crest, self.rim / (1 - self.crest))
        slope = steepness * math.pi / 2 * np.sin(angle)
        return value, slope / (2 * np.maximum(r, 1e-9))


@dataclass(frozen=True)
class Valley:
    """A valley along the length, sharp at its bottom, that runs out at both ends.

    ``(1 - u^4)^2 (1 - t)^2`` with ``t`` a hyperbola in ``v`` that goes from 0 to 1: the flanks
    of a plastic hinge, which die out into the skin. ``bluntness`` is 0 for an edge and 1/2 for
    ``(1 - v^2)^2``.

    Attributes
    ----------
    bluntness : float
        Radius of curvature at the bottom times 8 depth / width^2.
    kind : str
        ``'crease'``, or ``'gouge'`` where material is taken away.
    """

    bluntness: float = 0.1
    kind: str = 'crease'

    border = math.sqrt(2)

    def __post_init__(self) -> None:
        if not 0 < self.bluntness < 0.5:
            raise ConfigurationError(
                f'a {self.kind} is {2 * self.bluntness:.2g} times as blunt as its width and '
                'depth allow: give a smaller radius'
            )

    @classmethod
    def of_radius(cls, radius: float, width: float, depth: float, kind: str = 'crease') -> Valley:
        """The valley whose bottom has a radius of curvature, metres."""
        if not width > 0:
            raise ConfigurationError(f'the width of a {kind} is {width!r}: give a positive one')
        return cls(8 * abs(depth) / width * (radius / width), kind)

    def fraction(self, u: Field, v: Field) -> tuple[Field, Field, Field]:
        """Part of the depth, and its derivatives along `u` and `v`."""
        inside = (np.abs(u) < 1) & (np.abs(v) < 1)
        u, v = np.where(inside, u, 1.0), np.where(inside, v, 1.0)
        # Half width of the hyperbola's bottom: c (sqrt(1 + c^2) - c) = bluntness.
        c = self.bluntness / math.sqrt(1 - 2 * self.bluntness)
        norm = math.sqrt(1 + c * c) - c
        root = np.sqrt(v * v + c * c)
        t = (root - c) / norm
        along, across = (1 - u**4) ** 2, (1 - t) ** 2
        slope_u = -8 * u**3 * (1 - u**4) * across
        slope_v = -2 * (1 - t) * v / (root * norm) * along
        return along * across, slope_u, slope_v


SMOOTH = Smooth()
