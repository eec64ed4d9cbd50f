"""The blocks of a scene file, made into the parts of a world."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.simulation.dents import (
    Cap,
    Crater,
    Dent,
    FlatBottomed,
    Gaussian,
    Plate,
    RaisedCosine,
    Shape,
    Smooth,
    Valley,
)
from ftp_dent_ros.simulation.fields import Fields
from ftp_dent_ros.simulation.fittings import Bead, DomedRivet, Fitting, MissingRivet, Rivet
from ftp_dent_ros.simulation.flight import Flight
from ftp_dent_ros.simulation.form import Wave
from ftp_dent_ros.simulation.paint import (
    Dirt,
    Lettering,
    Mark,
    Paint,
    Patch,
    Sunlight,
    board_print,
    scratches,
)
from ftp_dent_ros.simulation.sensor import Photometry
from ftp_dent_ros.simulation.surface import Opening, Panel, Surface

_MATT = {'albedo': 0.8}
_RIVETS: dict[str, Any] = {'flush': Rivet, 'domed': DomedRivet, 'missing': MissingRivet}
_PLAIN_SHAPES: dict[str, Any] = {
    'smooth': Smooth,
    'cosine': RaisedCosine,
    'gaussian': Gaussian,
    'cap': Cap,
    'flat': FlatBottomed,
    'crater': Crater,
    'oil_can': Plate,
}
_VALLEYS = 'crease', 'gouge'
# Of one row: more is a slip of the pen.
_MOST_RIVETS = 10_000


def surface_from(scene: Fields) -> Surface:
    """The list `panels`, in ``map``."""
    panels = []
    for panel in scene.blocks('panels'):
        x_min, x_max, y_min, y_max = panel.numbers('extent', 4)
        panels.append(
            Panel(
                pose=panel.pose('pose'),
                extent=(x_min, x_max, y_min, y_max),
                cylinder_radius=panel.number('cylinder_radius', 0.0),
                paint=_paint(panel.block('paint', _MATT)),
                dents=tuple(map(_dent, panel.blocks('dents', ()))),
                rivets=tuple(_fittings(panel)),
                waves=tuple(part.record(Wave) for part in panel.blocks('waves', ())),
                openings=tuple(part.record(Opening) for part in panel.blocks('openings', ())),
                sunlight=tuple(part.record(Sunlight) for part in panel.blocks('sunlight', ())),
            )
        )
        panel.finish()
    if not panels:
        raise scene.error('panels', [], 'one panel or more')
    return Surface(tuple(panels))


def flight_from(fields: Fields) -> Flight:
    """The block `flight`."""
    flight = Flight(
        middle=fields.pose('middle'),
        length=fields.number('length'),
        speed=fields.number('speed'),
        sway=np.array(fields.numbers('sway', 3, (0, 0, 0))),
        wobble=np.array(fields.numbers('wobble', 3, (0, 0, 0))),
    )
    fields.finish()
    return flight


def photometry_from(fields: Fields) -> Photometry:
    """The block `photometry`; what it leaves out is as `Photometry` has it."""
    values = fields.rest()
    known = {field.name for field in dataclasses.fields(Photometry)}
    unknown = values.keys() - known
    if unknown:
        name = min(map(str, unknown))
        raise fields.error(name, values[name], f'only {", ".join(sorted(known))}')
    return Photometry(**values)


def _paint(fields: Fields) -> Paint:
    if 'board' in fields:
        return _print(fields)
    albedo = fields.colour('albedo', None)
    paint = Paint(
        albedo=albedo,
        edge=fields.numbers('edge', 3, (0, 0, 1)),  # type: ignore[arg-type]
        albedo_beyond=fields.colour('albedo_beyond', albedo),
        roughness=fields.number('roughness', 0.0),
        marks=tuple(mark for part in fields.blocks('marks', ()) for mark in _marks(part)),
    )
    if not 0 <= paint.roughness <= 1:
        raise fields.error('roughness', paint.roughness, '0 (matt) to 1')
    fields.finish()
    return paint


def _print(fields: Fields) -> Paint:
    """A calibration board's print; its first inner corner is the panel's origin."""
    part = fields.block('board')
    board = Board(
        part.whole('columns'),
        part.whole('rows'),
        part.number('square'),
        part.text('dictionary') if 'dictionary' in part else '',
        part.number('marker', 0.0),
        part.flag('legacy', False),
    )
    part.finish()
    fields.finish()
    return board_print(board)


def _marks(fields: Fields) -> tuple[Mark, ...]:
    """One mark, or the scratches of a seed."""
    kinds: dict[str, Callable[[Fields], tuple[Mark, ...]]] = {
        'dirt': lambda part: (part.record(Dirt),),
        'patch': lambda part: (part.record(Patch),),
        'lettering': lambda part: (part.record(Lettering),),
        'scratches': _scratches,
    }
    return fields.choice('kind', kinds)(fields)


def _scratches(fields: Fields) -> tuple[Mark, ...]:
    x_min, x_max, y_min, y_max = fields.numbers('extent', 4)
    marks = scratches(fields.whole('count'), (x_min, x_max, y_min, y_max), fields.whole('seed', 0))
    fields.finish()
    return marks


def _dent(fields: Fields) -> Dent:
    names = {name: name for name in (*_PLAIN_SHAPES, *_VALLEYS)}
    name = fields.choice('shape', names, 'smooth')
    length, width, depth = map(fields.number, ('length', 'width', 'depth'))
    shape: Shape
    if name in _VALLEYS:
        shape = Valley.of_radius(fields.number('radius', 0.002), width, depth, name)
    else:
        kind = _PLAIN_SHAPES[name]
        # The dataclass's defaults are its class's attributes.
        parts = {part.name: getattr(kind, part.name) for part in dataclasses.fields(kind)}
        shape = kind(**{part: fields.number(part, value) for part, value in parts.items()})
    dent = Dent(
        x=fields.number('x'),
        y=fields.number('y'),
        length=length,
        width=width,
        depth=depth,
        angle=fields.number('angle', 0.0),
        shape=shape,
        mark=fields.number('mark', 1.0),
    )
    fields.finish()
    return dent


def _fittings(panel: Fields) -> Iterator[Fitting]:
    """Rivets of all rows, and beads."""
    for row in panel.blocks('rivet_rows', ()):
        yield from _rivets(row)
    for bead in panel.blocks('beads', ()):
        yield bead.record(Bead)


def _rivets(fields: Fields) -> Iterator[Fitting]:
    """Rivets at equal steps from the first."""
    first, step = (np.array(fields.numbers(name, 2)) for name in ('first', 'step'))
    count = fields.whole('count')
    kind = fields.choice('kind', _RIVETS, 'flush')
    if count > _MOST_RIVETS:
        raise fields.error('count', count, f'at most {_MOST_RIVETS} rivets a row')
    # The dataclass's defaults are its class's attributes.
    shape = {
        part.name: fields.number(part.name, getattr(kind, part.name))
        for part in dataclasses.fields(kind)
        if part.name not in ('x', 'y')
    }
    fields.finish()
    for index in range(count):
        x, y = first + index * step
        yield kind(float(x), float(y), **shape)
