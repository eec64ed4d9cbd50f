"""A dent's profiles along length and width, as lines for the page's template to draw."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import MeasuredDent

_MM = 1000.0
# Of one profile's axes, in the drawing's units; the template puts the text around it.
WIDTH, HEIGHT = 300, 110
# Marks on an axis, about.
_MARKS_ALONG, _MARKS_DOWN = 6, 4


@dataclass(frozen=True)
class _Axis:
    """From millimetres to the drawing's units."""

    low: float
    high: float
    size: float

    def at(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return (values - self.low) / (self.high - self.low) * self.size

    def marks(self, about: int) -> list[dict[str, Any]]:
        """Round values on the axis."""
        step = _round_step((self.high - self.low) / about)
        values = step * np.arange(math.ceil(self.low / step), math.floor(self.high / step) + 1)
        places = max(0, -math.floor(math.log10(step)))
        return [
            {'at': f'{float(self.at(value)):.1f}', 'text': f'{value:.{places}f}'}
            for value in values + 0.0
        ]


def sections_of(dent: MeasuredDent, limit: float) -> dict[str, Any]:
    """Both profiles on one scale of depth; `limit` is its end, metres."""
    down = _Axis(min(-0.15 * limit, _lowest(dent)) * _MM, limit * _MM, HEIGHT)
    return {
        'width': WIDTH,
        'height': HEIGHT,
        'down': down.marks(_MARKS_DOWN),
        'skin': f'{float(down.at(np.array(0.0))):.1f}',
        'profiles': [
            _section(name, profile, size, dent.depth.value, down)
            for name, profile, size in (
                ('length', dent.length_profile, dent.length.value),
                ('width', dent.width_profile, dent.width.value),
            )
        ],
    }


def _section(
    name: str, profile: NDArray[np.float64], size: float, depth: float, down: _Axis
) -> dict[str, Any]:
    known = profile[np.isfinite(profile).all(axis=1)] if len(profile) else profile
    if len(known) < 2:
        return {'name': name, 'parts': [], 'along': [], 'span': None}
    at, below = known.T * _MM
    along = _Axis(float(at.min()), float(at.max()), WIDTH)
    span = None
    level = 0.1 * depth * _MM
    inside = at[np.sign(depth) * below >= abs(level)]
    if len(inside) and math.isfinite(size):
        # Between the ends of the part that lies within the 10 % contour.
        left, right = along.at(np.array([inside.min(), inside.max()]))
        span = {
            'left': f'{left:.1f}',
            'right': f'{right:.1f}',
            'middle': f'{(left + right) / 2:.1f}',
            'level': f'{float(down.at(np.array(level))):.1f}',
            'text': f'{size * _MM:.1f}',
        }
    parts = _parts(profile * _MM, along, down)
    return {'name': name, 'parts': parts, 'along': along.marks(_MARKS_ALONG), 'span': span}


def _parts(profile: NDArray[np.float64], along: _Axis, down: _Axis) -> list[dict[str, str]]:
    """What of a profile is measured, a line each, and from where to where."""
    known = np.isfinite(profile).all(axis=1)
    parts = []
    for part in np.split(profile, np.flatnonzero(np.diff(known)) + 1):
        if not np.isfinite(part).all():
            continue
        at, below = along.at(part[:, 0]), down.at(part[:, 1])
        line = ' '.join(f'{x:.1f},{y:.1f}' for x, y in zip(at, below, strict=True))
        parts.append({'line': line, 'first': f'{at[0]:.1f}', 'last': f'{at[-1]:.1f}'})
    return parts


def _lowest(dent: MeasuredDent) -> float:
    both = np.concatenate([dent.length_profile, dent.width_profile])
    return float(np.nanmin(both[:, 1])) if len(both) and np.isfinite(both[:, 1]).any() else 0.0


def _round_step(step: float) -> float:
    """The next round number: 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(each * power for each in (1, 2, 5, 10) if each * power >= 0.999 * step)
