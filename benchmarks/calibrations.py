"""A rig with lenses and light of its own, calibrated from rendered photographs of a board."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from boards import photographs, random_pose
from measures import MM, Figures, attempt, generator, root_mean_square
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.bundle import depth_slopes, depths
from ftp_dent_ros.calibration.observing import BoardSight, Photographs, observe
from ftp_dent_ros.calibration.sequence import Sequence
from ftp_dent_ros.calibration.solving import Solution, solve
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.files import find
from ftp_dent_ros.rig.rig import Lens, Rig, read_rig
from ftp_dent_ros.simulation import Photometry

BOARD = Board(10, 7, 0.025)
POSES = 8
DISTANCES = 0.6, 0.72, 0.9
# Where depths are looked at: so many places over the image, at these distances, metres.
_GRID, _DEPTHS = (9, 7), (0.6, 0.8, 1.0, 1.2)


def random_rig(rng: np.random.Generator) -> Rig:
    """A rig like the shipped one, with other lenses and another angle."""
    shipped = read_rig(find('shipped:rig.yaml'))

    def lens(like: Lens, strength: float) -> Lens:
        matrix = like.camera_matrix.copy()
        matrix[:2, :2] *= rng.uniform(0.9, 1.1)
        matrix[:2, 2] += rng.uniform(-25, 25, 2)
        k1, k2 = rng.uniform(-strength, 0.3 * strength), rng.uniform(-0.2, 0.5) * strength
        distortion = np.array([k1, k2, *rng.uniform(-1e-3, 1e-3, 2), 0])
        return replace(like, camera_matrix=matrix, distortion=distortion)

    turn = Rotation.from_euler('xyz', rng.uniform(-1.5, 1.5, 3), degrees=True).as_matrix()
    translation = shipped.translation * rng.uniform(0.9, 1.15)
    return Rig(
        lens(shipped.camera, 0.15),
        lens(shipped.projector, 0.08),
        turn @ shipped.rotation,
        translation,
    )


def random_light(rng: np.random.Generator) -> Photometry:
    """A projector and a camera of everyday quality."""
    return Photometry(
        exposure=rng.uniform(0.7, 0.95),
        reference_distance=0.7,
        ambient=rng.uniform(0.01, 0.08),
        defocus_px=rng.uniform(0.7, 1.6),
        projector_gamma=rng.uniform(1.0, 2.4),
        psf_px=rng.uniform(0.4, 0.9),
        read_noise=rng.uniform(0.8, 2.0),
        full_well=rng.uniform(6000, 15000),
    )


def calibration(name: str, seed: int, draw: int) -> dict[str, Figures]:
    """A rig of its own, photographed, read and solved."""
    rng = generator(seed, draw, name)
    rig, light = random_rig(rng), random_light(rng)
    figures: Figures = {}
    with attempt(figures):
        places = [random_pose(BOARD, rig, rng.choice(DISTANCES), rng) for _ in range(POSES)]
        sequence = Sequence(rig.projector.width, rig.projector.height)
        taken = photographs(rig, BOARD, sequence, places, light, int(rng.integers(1 << 30)))
        tries = [_sighted(f'pose_{number}', each, sequence) for number, each in enumerate(taken)]
        observations = [sight.observation for sight in tries if sight]
        figures['poses_refused'] = tries.count(None)
        sizes = ((lens.width, lens.height) for lens in (rig.camera, rig.projector))
        found = solve(observations, BOARD, *sizes)
        if found.held_out is not None:
            figures['camera_px'], figures['projector_px'] = map(float, found.held_out.rms[:2])
            figures['stereo_px'] = float(found.held_out.stereo_rms)
        figures |= _depths(rig, found)
    return {'board': figures}


def _sighted(name: str, taken: Photographs, sequence: Sequence) -> BoardSight | None:
    """A pose as it is read; None if it is refused, which a capture would take again."""
    try:
        return observe(name, taken, sequence, BOARD)
    except CalibrationError:
        return None


def _depths(rig: Rig, found: Solution) -> Figures:
    """Errors of depth over the image, and over what is stated of their largest components."""
    lens = rig.camera
    u, v = np.meshgrid(
        np.linspace(0, lens.width - 1, _GRID[0]), np.linspace(0, lens.height - 1, _GRID[1])
    )
    pixels = np.tile(np.stack([u.ravel(), v.ravel()], axis=1), (len(_DEPTHS), 1))
    distance = np.repeat(_DEPTHS, u.size)
    points = rig.camera.rays(pixels) * distance[:, None]
    column = rig.projector.project(rig.to_projector(points))[:, 0]
    lit = (column >= 0) & (column <= rig.projector.width - 1)
    pixels, distance, column = pixels[lit], distance[lit], column[lit]
    error = depths(found.rig, pixels, column) - distance
    size = MM * np.abs(error)
    figures: Figures = {'mae_mm': float(size.mean()), 'p95_mm': float(np.percentile(size, 95))}
    if found.rig.record is not None and found.rig.record.covariance is not None:
        slopes = depth_slopes(found.rig, pixels, distance)
        figures['depth_over_u'] = _normalised(
            error, slopes @ found.rig.record.covariance @ slopes.T
        )
    return figures


def _normalised(error: NDArray, covariance: NDArray) -> float:
    """Of the error along the three largest components, over their deviations."""
    variances, ways = np.linalg.eigh(covariance)
    return root_mean_square(ways.T[:-4:-1] @ error / np.sqrt(variances[:-4:-1]))
