"""The simulated world: skin, flight, light and the camera's mount, as functions of ROS time."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.errors import CameraError, ConfigurationError
from ftp_dent_ros.fields import Count, Fields, Limits, Pair, Positive, Share, Triple
from ftp_dent_ros.files import find
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Rig
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
from ftp_dent_ros.simulation.flight import EstimateErrors, Faults, Flight
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
from ftp_dent_ros.simulation.renderer import Renderer
from ftp_dent_ros.simulation.sensor import Photometry
from ftp_dent_ros.simulation.surface import Panel, Surface, Wave
from ftp_dent_ros.simulation.view import CameraMotion
from ftp_dent_ros.yaml_file import read_yaml

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
# The optical frame of a camera that looks along the drone's nose.
_FORWARD = {'translation': [0.1, 0, 0], 'rpy': [-math.pi / 2, 0, -math.pi / 2]}


@dataclass(frozen=True, eq=False)
class World:
    """A world in which one drone flies; times are ROS times in nanoseconds.

    Attributes
    ----------
    surface : Surface
        The skin in ``map`` (ENU).
    flight : Flight
    mount : Pose
        Of ``camera_optical_frame`` in ``base_link``.
    photometry : Photometry
    exposure_time : float
        Seconds.
    seed : int
        Of all noise; the same seed and time give the same photograph.
    start_ns : int
        When the flight starts. It goes on for ever, before its start too.
    errors : EstimateErrors
        How the autopilot's estimate is off; none by default.
    faults : Faults
        What goes wrong with the autopilot; nothing by default.
    board_poses : tuple of Pose
        Of the first panel, one after the other: somebody holds a board.
    """

    surface: Surface
    flight: Flight
    mount: Pose
    photometry: Photometry
    exposure_time: float
    seed: int = 0
    start_ns: int = 0
    errors: EstimateErrors = field(default_factory=EstimateErrors)
    faults: Faults = field(default_factory=Faults)
    board_poses: tuple[Pose, ...] = ()

    def flight_time(self, stamp_ns: int) -> float:
        """Seconds into the flight's period, exact to a nanosecond at any date."""
        return (stamp_ns - self.start_ns) % self.flight.period_ns / 1e9

    def base_pose(self, stamp_ns: int) -> Pose:
        """Pose of ``base_link`` in ``map``."""
        return self.flight.pose(self.flight_time(stamp_ns))

    def camera_pose(self, stamp_ns: int) -> Pose:
        """Pose of ``camera_optical_frame`` in ``map``."""
        return self.base_pose(stamp_ns) @ self.mount

    def seen_surface(self, stamp_ns: int) -> Surface:
        """The skin in the camera's optical frame."""
        return self.surface.transformed(self.camera_pose(stamp_ns).inverse())

    def motion(self, stamp_ns: int) -> CameraMotion:
        """How the skin moves before the camera during an exposure around a time."""
        half_ns = round(self.exposure_time * 5e8)
        begin, end = (self.camera_pose(stamp_ns + shift) for shift in (-half_ns, half_ns))
        change = end.inverse() @ begin
        return CameraMotion(change.rotation.as_rotvec(), change.translation)

    def photograph(self, rig: Rig, projected: NDArray[np.uint8], stamp_ns: int) -> Photograph:
        """What the camera sees when the projector shows an image.

        Parameters
        ----------
        rig : Rig
        projected : ndarray, shape (projector height, projector width, 3), uint8
            RGB.
        stamp_ns : int
            The middle of the exposure.

        Returns
        -------
        Photograph

        Raises
        ------
        ImageError
            The projected image is not the projector's size or type.
        """
        image = projected.tobytes(), projected.dtype.str, projected.shape
        renderer = _renderer(rig, image, self.photometry)
        rng = np.random.default_rng([self.seed, abs(stamp_ns)])
        return renderer.photograph(self.seen_surface(stamp_ns), rng, self.motion(stamp_ns))


@lru_cache(maxsize=2)
def _renderer(
    rig: Rig, projected: tuple[bytes, str, tuple[int, ...]], photometry: Photometry
) -> Renderer:
    """Renderers of the last images that were projected, by their content."""
    content, dtype, shape = projected
    return Renderer(rig, np.frombuffer(content, dtype).reshape(shape), photometry)


@lru_cache(maxsize=1)
def _world_of(file: Path, start_ns: int, version: tuple[int, int]) -> World:
    """The world of a version of a file; the last is kept."""
    return read_world(file, start_ns)


def read_world(path: str | os.PathLike[str], start_ns: int = 0) -> World:
    """Read a scene file of the user's, or a shipped one by ``shipped:NAME``.

    Parameters
    ----------
    path : path
        As ``config/scene.yaml``, which explains its fields.
    start_ns : int
        ROS time at which the flight starts.

    Raises
    ------
    ConfigurationError
        The file cannot be read, or a field is missing, unknown or malformed; it is named.
    """
    file = find(path)
    scene = Fields(read_yaml(file, ConfigurationError), f'{file}: ')
    camera, autopilot = scene.block('camera'), scene.block('autopilot', {})
    flight = scene.block('flight')
    world = World(
        surface=_surface(scene),
        flight=flight.record(Flight, middle=_pose(flight.block('middle'))),
        mount=_pose(camera.block('mount', _FORWARD)),
        photometry=scene.block('photometry', {}).record(Photometry),
        exposure_time=camera.take('exposure_time', Share),
        seed=camera.take('seed', Count, 0),
        start_ns=start_ns,
        errors=autopilot.block('errors', {}).record(EstimateErrors),
        faults=autopilot.block('faults', {}).record(Faults),
        board_poses=tuple(map(_pose, scene.blocks('board_poses', ()))),
    )
    for block in (camera, autopilot, scene):
        block.finish()
    return world


def _pose(fields: Fields) -> Pose:
    """A block's `translation` (metres) and `rpy` (roll, pitch, yaw, radians: REP 103)."""
    pose = Pose.from_rpy(fields.take('rpy', Triple), fields.take('translation', Triple))
    fields.finish()
    return pose


def _surface(scene: Fields) -> Surface:
    """The list `panels`, in ``map``."""
    panels = tuple(
        panel.record(
            Panel,
            pose=_pose(panel.block('pose')),
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


class LiveWorld:
    """The world of a scene file that is read again when it has changed: somebody moves a board.

    A board with `board_poses` is moved to the next one by the second photograph in a row under
    white light: ``ftp-dent calibrate capture`` takes two between one pose and the next.

    Parameters
    ----------
    path : path
    start_ns : int
        ROS time at which the flight starts, nanoseconds.

    Raises
    ------
    ConfigurationError
        The file cannot be used.
    """

    def __init__(self, path: str | os.PathLike[str], start_ns: int) -> None:
        self._path, self._start_ns = find(path), start_ns
        self._whites = self._moves = 0
        self._read()

    def photograph(self, rig: Rig, projected: NDArray[np.uint8], stamp_ns: int) -> Photograph:
        """As `World.photograph`; raises `CameraError` while the changed file cannot be used."""
        try:
            world = self._read()
        except ConfigurationError as reason:
            raise CameraError(str(reason)) from None
        if world.board_poses:
            self._whites = self._whites + 1 if projected.min() > 250 else 0
            self._moves += self._whites == 2
            board, *others = world.surface.panels
            pose = world.board_poses[self._moves % len(world.board_poses)]
            world = replace(world, surface=Surface((replace(board, pose=pose), *others)))
        return world.photograph(rig, projected, stamp_ns)

    def _read(self) -> World:
        status = find(self._path).stat()
        return _world_of(self._path, self._start_ns, (status.st_mtime_ns, status.st_ino))
