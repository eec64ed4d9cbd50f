"""The blocks of a scene file, made into the parts of a world."""

from __future__ import annotations

from collections.abc import Iterator
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
    Smooth,
    Valley,
)
from ftp_dent_ros.simulation.fields import Fields
from ftp_dent_ros.simulation.fittings import DomedRivet, Fitting, Rivet
from ftp_dent_ros.simulation.flight import Flight
from ftp_dent_ros.simulation.paint import (
    Dirt,
    Lettering,
    Mark,
    Paint,
    PaintPatch,
    Sunlight,
    board_print,
    scratches,
)
from ftp_dent_ros.simulation.surface import Panel, Surface, Wave

_MARKS: dict[str, Any] = {
    'dirt': Dirt,
    'patch': PaintPatch,
    'lettering': Lettering,
    'scratches': None,
}
_RIVETS: dict[str, Any] = {'flush': Rivet, 'domed': DomedRivet}
_SHAPES: dict[str, Any] = {
    'smooth': Smooth,
    'cosine': RaisedCosine,
    'gaussian': Gaussian,
    'cap': Cap,
    'flat': FlatBottomed,
    'crater': Crater,
    'oil_can': Plate,
    'crease': Valley,
    'gouge': Valley,
}
_EXTENT = 'tuple[float, float, float, float]'


def surface_from(scene: Fields) -> Surface:
    """The list `panels`, in ``map``."""
    panels = tuple(
        panel.record(
            Panel,
            pose=panel.pose('pose'),
            paint=_paint(panel.block('paint', {'albedo': 0.8})),
            dents=tuple(map(_dent, panel.blocks('dents', ()))),
            rivets=tuple(r for row in panel.blocks('rivet_rows', ()) for r in _rivets(row)),
            waves=tuple(part.record(Wave) for part in panel.blocks('waves', ())),
            sunlight=tuple(part.record(Sunlight) for part in panel.blocks('sunlight', ())),
        )
        for panel in scene.blocks('panels')
    )
    if not panels:
        raise scene.error('panels', [], 'one panel or more')
    return Surface(panels)


def flight_from(fields: Fields) -> Flight:
    """The block `flight`."""
    three, none = 'tuple[float, float, float]', (0, 0, 0)
    return fields.record(
        Flight,
        middle=fields.pose('middle'),
        sway=np.array(fields.take('sway', three, none)),
        wobble=np.array(fields.take('wobble', three, none)),
    )


def _paint(fields: Fields) -> Paint:
    if 'board' in fields:
        # A calibration board's print; its first inner corner is the panel's origin.
        board = fields.block('board')
        none = {} if 'dictionary' in board else {'dictionary': ''}
        paint: Paint = board_print(board.record(Board, **none))
        fields.finish()
        return paint
    albedo = fields.take('albedo', 'Colour')
    marks = tuple(mark for part in fields.blocks('marks', ()) for mark in _marks(part))
    beyond = fields.take('albedo_beyond', 'Colour', albedo)
    for name, colour in (('albedo', albedo), ('albedo_beyond', beyond)):
        if max(colour) > 1:
            raise fields.error(name, list(colour), 'one or three numbers from 0 to 1')
    roughness = fields.take('roughness', 'float', 0.0)
    if not 0 <= roughness <= 1:
        raise fields.error('roughness', roughness, '0 (matt) to 1')
    return fields.record(
        Paint, albedo=albedo, albedo_beyond=beyond, marks=marks, roughness=roughness
    )


def _marks(fields: Fields) -> tuple[Mark, ...]:
    """One mark, or the scratches of a seed."""
    kind = fields.choice('kind', _MARKS)
    if kind is not None:
        return (fields.record(kind),)
    count, seed = fields.take('count', 'int'), fields.take('seed', 'int', 0)
    marks = scratches(count, fields.take('extent', _EXTENT), seed)
    fields.finish()
    return marks


def _dent(fields: Fields) -> Dent:
    name = fields.choice('shape', {each: each for each in _SHAPES}, 'smooth')
    kind = _SHAPES[name]
    if kind is Valley:
        width, depth = fields.take('width', 'float'), fields.take('depth', 'float')
        radius = fields.take('radius', 'float', 0.002)
        shape = Valley.of_radius(radius, width, depth, name)
        return fields.record(Dent, shape=shape, width=width, depth=depth)
    # The dataclass's defaults are its class's attributes.
    parts = {part: fields.take(part, 'float', getattr(kind, part)) for part in kind.__match_args__}
    return fields.record(Dent, shape=kind(**parts))


def _rivets(fields: Fields) -> Iterator[Fitting]:
    """Rivets at equal steps from the first."""
    first, step = (np.array(fields.take(n, 'tuple[float, float]')) for n in ('first', 'step'))
    count, kind = fields.take('count', 'int'), fields.choice('kind', _RIVETS, 'flush')
    if count > 10_000:
        raise fields.error('count', count, 'at most 10000 rivets a row')
    one = fields.record(kind, x=0.0, y=0.0)
    for index in range(count):
        x, y = first + index * step
        yield kind(**{**one.__dict__, 'x': float(x), 'y': float(y)})
