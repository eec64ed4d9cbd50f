"""The blocks of a scene file, made into the parts of a world."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from ftp_dent_ros.simulation.dent import Dent, Rivet
from ftp_dent_ros.simulation.fields import Fields
from ftp_dent_ros.simulation.flight import Flight
from ftp_dent_ros.simulation.paint import Paint
from ftp_dent_ros.simulation.panel import Panel
from ftp_dent_ros.simulation.photometry import Photometry
from ftp_dent_ros.simulation.surface import Surface

_MATT = {'albedo': 0.8}


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
                rivets=tuple(
                    rivet for row in panel.blocks('rivet_rows', ()) for rivet in _rivets(row)
                ),
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
    albedo = fields.colour('albedo', None)
    paint = Paint(
        albedo=albedo,
        edge=fields.numbers('edge', 3, (0, 0, 1)),  # type: ignore[arg-type]
        albedo_beyond=fields.colour('albedo_beyond', albedo),
        roughness=fields.number('roughness', 0.0),
    )
    if not 0 <= paint.roughness <= 1:
        raise fields.error('roughness', paint.roughness, '0 (matt) to 1')
    fields.finish()
    return paint


def _dent(fields: Fields) -> Dent:
    dent = Dent(
        x=fields.number('x'),
        y=fields.number('y'),
        length=fields.number('length'),
        width=fields.number('width'),
        depth=fields.number('depth'),
        angle=fields.number('angle', 0.0),
    )
    fields.finish()
    return dent


def _rivets(fields: Fields) -> Iterator[Rivet]:
    """Rivets at equal steps from the first."""
    first, step = (np.array(fields.numbers(name, 2)) for name in ('first', 'step'))
    count = fields.whole('count')
    # The dataclass's defaults are its class's attributes.
    shape = {
        name: fields.number(name, getattr(Rivet, name))
        for name in ('radius', 'groove', 'sigma', 'proud', 'dirt')
    }
    fields.finish()
    for index in range(count):
        x, y = first + index * step
        yield Rivet(float(x), float(y), **shape)
