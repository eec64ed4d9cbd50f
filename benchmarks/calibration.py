"""Calibration of simulated rigs, each with its own lenses, light, noise and poses.

python benchmarks/calibration.py [--seeds 20] [--first 100] [--poses 15]

The renderer takes every photograph. A row a rig: RMS of camera, projector and stereo (against the
true pixels: systematic part in brackets), errors of focal lengths and baseline, share of depths
within their stated 95 % interval, and clouds with the estimated rig: a dented sample at 60 cm and
a plane at 120 cm against the truth, and depths of dents against those with the true rig.

A rig's depths err together, so its intervals hold nearly all or nearly none of them: the stated
covariance of the depths is split into its independent components, and the error along each of the
largest, over its stated deviation, is a fair test, one number a rig (z 1, z 2, z 3). What share
within their intervals a rig must be expected to have is drawn from the same covariance.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.bundle import depth_slopes, depths
from ftp_dent_ros.calibration.observing import Photographs, Sight, observe
from ftp_dent_ros.calibration.sequence import Sequence
from ftp_dent_ros.calibration.solving import Solution, solve
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Lens, Rig, read_rig
from ftp_dent_ros.simulation import Dent, Panel, Photometry, Surface, render
from ftp_dent_ros.simulation.boards import photographs, random_pose, true_correspondences

BOARD = Board(10, 7, 0.025)
NAMES = (
    *('camera px', 'projector px', 'stereo px', 'bias px', 'f_c %', 'f_p %', 'b mm', 'depth mm'),
    *('within %', 'norm', 'z 1', 'z 2', 'z 3', 'part of 1 %'),
    *('1 in 10 %', '1 in 20 %', '60 cm mm', '120 cm mm', 'dents mm', 'CPU s'),
)
# A normal distribution's 95 %.
_SURE = 1.96


def random_rig(rng: np.random.Generator) -> Rig:
    """A rig like the shipped one, with other lenses and another angle."""
    shipped = read_rig(config_folder() / 'rig.yaml')

    def lens(like: Lens, strength: float) -> Lens:
        matrix = like.camera_matrix.copy()
        matrix[:2, :2] *= rng.uniform(0.9, 1.1)
        matrix[:2, 2] += rng.uniform(-25, 25, 2)
        k1, k2 = rng.uniform(-strength, 0.3 * strength), rng.uniform(-0.2, 0.5) * strength
        return replace(
            like,
            camera_matrix=matrix,
            distortion=np.array([k1, k2, *rng.uniform(-1e-3, 1e-3, 2), 0]),
        )

    turn = Rotation.from_euler('xyz', rng.uniform(-1.5, 1.5, 3), degrees=True).as_matrix()
    return Rig(
        lens(shipped.camera, 0.15),
        lens(shipped.projector, 0.08),
        turn @ shipped.rotation,
        shipped.translation * rng.uniform(0.9, 1.15),
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


def figures(seed: int, poses: int) -> list[float]:
    """One row of the table."""
    rng = np.random.default_rng(seed)
    rig, light = random_rig(rng), random_light(rng)
    places = [random_pose(BOARD, rig, rng.choice([0.6, 0.72, 0.9]), rng) for _ in range(poses)]
    sequence = Sequence(rig.projector.width, rig.projector.height)
    taken = photographs(rig, BOARD, sequence, places, light, seed)
    begin = time.process_time()
    tries = [sighted(f'{seed}: pose_{i}', each, sequence) for i, each in enumerate(taken)]
    seen = [sight for sight in tries if sight]
    kept = [place for place, sight in zip(places, tries, strict=True) if sight]
    found = solve(
        [each.observation for each in seen],
        BOARD,
        (rig.camera.width, rig.camera.height),
        (rig.projector.width, rig.projector.height),
    )
    spent = time.process_time() - begin
    bias = []
    for sight, place in zip(seen, kept, strict=True):
        for got, true in zip(
            (sight.observation.camera, sight.observation.projector),
            true_correspondences(BOARD, rig, place),
            strict=True,
        ):
            bias.append(np.nanmean(got - true, axis=0))
    checked = found.held_out
    assert checked is not None
    error, covariance = depth_errors(rig, found)
    deviation = np.sqrt(np.diag(covariance))
    matrices = [
        (a.camera_matrix[0, 0] / b.camera_matrix[0, 0] - 1) * 100
        for a, b in ((found.rig.camera, rig.camera), (found.rig.projector, rig.projector))
    ]
    baseline = np.linalg.norm(found.rig.translation) - np.linalg.norm(rig.translation)
    return [
        checked.rms[0],
        checked.rms[1],
        checked.stereo_rms,
        float(np.abs(np.mean(np.reshape(bias, (-1, 2, 2)), axis=0)).max()),
        *matrices,
        1e3 * baseline,
        1e3 * float(np.abs(error).mean()),
        100 * float(np.mean(np.abs(error) < _SURE * deviation)),
        float(np.sqrt(np.mean(np.square(error / deviation)))),
        *components(error, covariance),
        *expected_shares(covariance, rng),
        *clouds(rig, found.rig, light),
        spent,
    ]


def sighted(name: str, taken: Photographs, sequence: Sequence) -> Sight | None:
    """A pose as it is read; None if it is refused, which a capture would take again."""
    try:
        return observe(name, taken, sequence, BOARD)
    except CalibrationError as reason:
        tqdm.write(str(reason))
        return None


def depth_errors(rig: Rig, found: Solution) -> tuple[NDArray, NDArray]:
    """Errors of depth over the image at 0.6 to 1.2 m, and their stated covariance."""
    u, v = np.meshgrid(
        np.linspace(0, rig.camera.width - 1, 9), np.linspace(0, rig.camera.height - 1, 7)
    )
    pixels = np.tile(np.stack([u.ravel(), v.ravel()], axis=1), (4, 1))
    distance = np.repeat([0.6, 0.8, 1.0, 1.2], u.size)
    points = rig.camera.rays(pixels) * distance[:, None]
    column = rig.projector.project(rig.to_projector(points))[:, 0]
    lit = (column >= 0) & (column <= rig.projector.width - 1)
    pixels, distance, column = pixels[lit], distance[lit], column[lit]
    error = depths(found.rig, pixels, column) - distance
    record = found.rig.record
    assert record is not None and record.covariance is not None
    slopes = depth_slopes(found.rig, pixels, distance)
    return error, slopes @ record.covariance @ slopes.T


def components(error: NDArray, covariance: NDArray) -> list[float]:
    """Errors along the three largest components over their deviations; the largest's part, %."""
    variances, ways = np.linalg.eigh(covariance)
    z = ways.T[:-4:-1] @ error / np.sqrt(variances[:-4:-1])
    return [*z.tolist(), 100 * float(variances[-1] / variances.sum())]


def expected_shares(covariance: NDArray, rng: np.random.Generator) -> tuple[float, float]:
    """Share of depths in their intervals that one rig in ten, and in twenty, falls below; %."""
    variances, ways = np.linalg.eigh(covariance)
    drawn = rng.normal(size=(2000, len(variances))) * np.sqrt(np.maximum(variances, 0)) @ ways.T
    shares = np.mean(np.abs(drawn) < _SURE * np.sqrt(np.diag(covariance)), axis=1)
    of_ten, of_twenty = 100 * np.percentile(shares, [10, 5])
    return float(of_ten), float(of_twenty)


def clouds(rig: Rig, estimated: Rig, light: Photometry) -> tuple[float, float, float]:
    """MAE at 60 and 120 cm, and the largest change of a dent's depth; millimetres."""
    pattern = Pattern(rig.projector.width, rig.projector.height, 10.0, 640.0)
    results, change = [], 0.0
    for distance, dent in ((0.6, Dent(0.0, 0.0, 0.06, 0.04, 0.002)), (1.2, None)):
        pose = Pose.from_rpy((0.03, -0.05, 0.02), (0.0, 0.0, distance))
        half = 0.3 * distance
        panel = Panel(pose, (-half, half, -half, half), dents=(dent,) if dent else ())
        surface = Surface((panel,))
        photo = render(rig, pattern.draw(), surface, replace(light, reference_distance=distance))
        points = {}
        for name, each in (('true', rig), ('estimated', estimated)):
            points[name] = Reconstructor(each, pattern, Settings()).measure(photo).cloud.points
        valid = np.isfinite(points['estimated'][..., 2])
        off = surface.distance(points['estimated'][valid].astype(float))
        results.append(1e3 * float(np.abs(off).mean()))
        if dent:
            change = abs(
                _dent_depth(points['estimated'], pose) - _dent_depth(points['true'], pose)
            )
    return results[0], results[1], 1e3 * change


def _dent_depth(points: NDArray, pose: Pose) -> float:
    """Depth of the dent at the panel's middle below a plane about it, metres."""
    local = pose.inverse().apply(points[np.isfinite(points[..., 2])].astype(float))
    x, y, z = local.T
    around = (np.hypot(x, y) > 0.035) & (np.hypot(x, y) < 0.06)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    plane, *_ = np.linalg.lstsq(basis[around], z[around], rcond=None)
    middle = np.hypot(x, y) < 0.003
    return float(np.mean((z - basis @ plane)[middle]))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--first', type=int, default=100)
    parser.add_argument('--poses', type=int, default=15)
    arguments = parser.parse_args()
    rows = []
    print('seed  ' + '  '.join(f'{name:>12}' for name in NAMES))
    for seed in tqdm(range(arguments.first, arguments.first + arguments.seeds), unit='rig'):
        rows.append(figures(seed, arguments.poses))
        tqdm.write(f'{seed:4}  ' + '  '.join(f'{value:12.4f}' for value in rows[-1]), sys.stdout)
        sys.stdout.flush()
    table = np.array(rows)
    for name, values in (('mean', table.mean(axis=0)), ('worst', np.abs(table).max(axis=0))):
        print(f'{name:5} ' + '  '.join(f'{value:12.4f}' for value in values))
    first = NAMES.index('z 1')
    spread = np.sqrt(np.mean(np.square(table[:, first : first + 3]), axis=0))
    print('z of the largest components, rms: {:.2f}, {:.2f}, {:.2f}'.format(*spread))
    return 0


if __name__ == '__main__':
    sys.exit(main())
