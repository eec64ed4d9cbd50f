"""The blocks of a scene file, made into the parts of a world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.fields import Fields, Limits, Pair, Positive, Triple
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.dents import (
    Cap,
    Crater,
    Dent,
    FlatBottomed,
    Gaussian,
    Plate,
    RaisedCosine,
    Rivet,
    Smooth,
    Valley,
    domed_rivet,
)
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
    'scratches': scratches,
}
_RIVETS: dict[str, Any] = {'flush': Rivet, 'domed': domed_rivet}
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


def pose_from(fields: Fields) -> Pose:
    """A block's `translation` (metres) and `rpy` (roll, pitch, yaw, radians: REP 103)."""
    pose = Pose.from_rpy(fields.take('rpy', Triple), fields.take('translation', Triple))
    fields.finish()
    return pose


def surface_from(scene: Fields) -> Surface:
    """The list `panels`, in ``map``."""
    panels = tuple(
        panel.record(
            Panel,
            pose=pose_from(panel.block('pose')),
            paint=_paint(panel.block('paint', {})),
            dents=tuple(map(_dent, panel.blocks('dents', ()))),
            rivets=tuple(r for row in panel.blocks('rivet_rows', ()) for r in _rivets(row)),
            waves=tuple(part.record(Wave) for part in panel.blocks('waves', ())),
            sunlight=tuple(part.record(Sunlight) for part in panel.blocks('sunlight', ())),
        )
        for panel in scene.blocks('panels')
    )
    if not panels:
        raise scene.refusal('panels', [], 'one panel or more')
    return Surface(panels)


def _paint(fields: Fields) -> Paint:
    if 'board' in fields:
        # A calibration board's print; its first inner corner is the panel's origin.
        paint = board_print(fields.take('board', Board))
        fields.finish()
        return paint
    marks = tuple(mark for part in fields.blocks('marks', ()) for mark in _marks(part))
    return fields.record(Paint, marks=marks)


def _marks(fields: Fields) -> tuple[Mark, ...]:
    """One mark, or the scratches of a seed."""
    made = fields.record(fields.choice('kind', _MARKS))
    return made if isinstance(made, tuple) else (made,)


def _dent(fields: Fields) -> Dent:
    name = fields.take('shape', Annotated[str, Limits(choices=tuple(_SHAPES))], 'smooth')
    kind = _SHAPES[name]
    if kind is Valley:
        width, depth = fields.take('width', Positive), fields.take('depth', float)
        shape = fields.part(Valley.of_radius, width=width, depth=depth, kind=name)
        return fields.record(Dent, shape=shape, width=width, depth=depth)
    return fields.record(Dent, shape=fields.part(kind))


def _rivets(fields: Fields) -> Iterator[Rivet | Dent]:
    """Rivets at equal steps from the first."""
    first, step = (np.array(fields.take(name, Pair)) for name in ('first', 'step'))
    count = fields.take('count', Annotated[int, Limits(0, 10_000)])
    one = fields.record(fields.choice('kind', _RIVETS, 'flush'), x=0.0, y=0.0)
    for index in range(count):
        x, y = first + index * step
        yield replace(one, x=float(x), y=float(y))
