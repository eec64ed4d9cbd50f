"""A board before a rig, photographed under each frame of a sequence by the project's renderer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.sequence import ProjectedFrame, Sequence
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation.paint import board_print
from ftp_dent_ros.simulation.renderer import Light
from ftp_dent_ros.simulation.sensor import Photometry, read_out
from ftp_dent_ros.simulation.surface import Panel, Surface
from ftp_dent_ros.simulation.view import (
    NOTHING,
    albedo_table,
    broken_pixels,
    look,
    pixel_grid,
    see,
    still,
)

# Points of a pixel's light: four on a star whose variance is a square's, more at edges.
_STAR = np.float32(np.sqrt(1 / 6))
_FINE = 4


def board_surface(board: Board, pose: Pose) -> Surface:
    """The board as a panel; `pose` is that of its first corner in the camera's frame."""
    side = board.square
    extent = (
        -1.5 * side,
        (board.columns + 0.5) * side,
        -1.5 * side,
        (board.rows + 0.5) * side,
    )
    return Surface((Panel(pose, extent, paint=board_print(board)),))


def random_pose(board: Board, rig: Rig, distance: float, rng: np.random.Generator) -> Pose:
    """A board that camera and projector see whole, tilted by up to 35 degrees."""
    middle = board.points.mean(axis=0)
    for _ in range(1000):
        tilt = rng.uniform(-35, 35, 2)
        turn = Rotation.from_euler('zyx', [rng.uniform(-20, 20), *tilt], degrees=True)
        pixel = rng.uniform(0.2, 0.8, 2) * [rig.camera.width, rig.camera.height]
        at = rig.camera.rays(pixel) * distance * rng.uniform(0.85, 1.2)
        pose = Pose(turn, at - turn.apply(middle))
        if _in_view(board, rig, pose):
            return pose
    raise ConfigurationError('no pose shows the whole board: choose a smaller one or a distance')


def _in_view(board: Board, rig: Rig, pose: Pose) -> bool:
    rim = 0.9 * board.square * np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]])
    points = pose.apply((board.points[:, None] + rim).reshape(-1, 3))
    for lens, seen in ((rig.camera, points), (rig.projector, rig.to_projector(points))):
        pixel = lens.project(seen)
        if (pixel < 2).any() or (pixel > [lens.width - 3, lens.height - 3]).any():
            return False
    return True


def true_correspondences(board: Board, rig: Rig, pose: Pose) -> tuple[NDArray, NDArray]:
    """Camera and projector pixels of the corners."""
    points = pose.apply(board.points)
    return rig.camera.project(points), rig.projector.project(rig.to_projector(points))


class StillBoard:
    """A board that stands still: what its pixels see is computed once for all frames.

    Parameters
    ----------
    rig : Rig
    surface : Surface
        In the camera's frame, one panel.
    photometry : Photometry
        Without speckle, colours or motion.
    """

    def __init__(self, rig: Rig, surface: Surface, photometry: Photometry) -> None:
        self._photometry = replace(photometry, encoding='mono8')
        self._light_of = Light(np.zeros((*_size(rig), 3), np.uint8), photometry)
        grid = pixel_grid(rig.camera)
        view = see(rig, surface, photometry)
        rows, columns = np.nonzero(view.tone != NOTHING)
        part = _widened(rows, view.u.shape[0]), _widened(columns, view.u.shape[1])
        albedo = albedo_table(surface)[1]
        seen = albedo[view.tone] * view.clean
        gain = np.float32(photometry.exposure) * grid.vignette
        self._lit = (gain * (seen * view.diffuse + view.specular))[part].astype(np.float32)
        self._ambient = (gain * seen * photometry.ambient).astype(np.float32)
        place = self._light_of.index(view.u, view.v)
        slopes = np.gradient(place, axis=2), np.gradient(place, axis=1)
        self._places = [
            (place + sign * slope)[:, part[0], part[1]].copy()
            for slope in slopes
            for sign in (-_STAR, _STAR)
        ]
        self._part = part
        broken = broken_pixels(rig, surface, view, 0.0)
        self._broken = np.unique(np.concatenate(broken)) if broken else np.zeros(0, np.intp)
        offsets = (np.arange(_FINE) + 0.5) / _FINE - 0.5
        along_u, along_v = (part.ravel() for part in np.meshgrid(offsets, offsets))
        directions = grid.rays_within(self._broken, along_u, along_v)
        fine = look(rig, surface, still(directions.reshape(-1, 3)), photometry)
        weight = albedo[fine.tone] * fine.clean
        self._fine = fine.u, fine.v, weight * fine.diffuse + fine.specular
        self._fine_gain = gain.ravel()[self._broken]
        ambient = photometry.ambient * weight.reshape(-1, _FINE**2).mean(axis=1)
        self._ambient.ravel()[self._broken] = self._fine_gain * ambient

    def photograph(self, light: Light, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Grey photograph of the board in a projector's light."""
        signal = self._ambient.copy()
        samples = [light.sample(*place)[..., 0].astype(np.float32) for place in self._places]
        signal[self._part] += self._lit * np.mean(samples, axis=0) * light.unit
        u, v, weight = self._fine
        fine = (light.at(u, v)[0] * weight).reshape(-1, _FINE**2).mean(axis=1)
        ambient = self._ambient.ravel()[self._broken]
        signal.ravel()[self._broken] = ambient + self._fine_gain * fine
        return read_out(signal[None], self._photometry, rng).pixels


def photographs(
    rig: Rig,
    board: Board,
    sequence: Sequence,
    poses: list[Pose],
    photometry: Photometry,
    seed: int = 0,
) -> list[dict[ProjectedFrame, NDArray[np.uint8]]]:
    """Grey photographs of every pose under every frame."""
    rng = np.random.default_rng(seed)
    lights = {frame: Light(sequence.draw(frame), photometry) for frame in sequence.frames}
    taken = []
    for pose in poses:
        still_board = StillBoard(rig, board_surface(board, pose), photometry)
        taken.append({f: still_board.photograph(light, rng) for f, light in lights.items()})
    return taken


def _size(rig: Rig) -> tuple[int, int]:
    return rig.projector.height, rig.projector.width


def _widened(indices: NDArray, size: int) -> slice:
    return slice(max(int(indices.min()) - 4, 0), min(int(indices.max()) + 5, size))
