"""Time from photographs to a rig: 15 poses of 30 photographs at 1920x1080.

python benchmarks/calibration_speed.py [--size 1920x1080] [--poses 15] [--rendered 2]

One pose costs what another costs: `rendered` of them are photographed, and their reading is timed;
the rest are taken at their mean. All poses are solved, from corners with the noise of rendered
ones. Processor time, of one core.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.observing import Observation, observe
from ftp_dent_ros.calibration.sequence import Sequence
from ftp_dent_ros.calibration.solving import STEPS, solve
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.rig.rig import Lens, Rig, read_rig
from ftp_dent_ros.simulation import Photometry
from ftp_dent_ros.simulation.boards import photographs, random_pose, true_correspondences

BOARD = Board(10, 7, 0.025)
# Of corners in rendered photographs, pixels, standard deviation.
_NOISE = 0.02


def scaled(lens: Lens, width: int, height: int) -> Lens:
    """A lens of the same view with other pixels."""
    factor = np.array([width / lens.width, height / lens.height])
    matrix = lens.camera_matrix.copy()
    matrix[[0, 1], [0, 1]] *= factor
    matrix[:2, 2] = (matrix[:2, 2] + 0.5) * factor - 0.5
    return replace(lens, width=width, height=height, camera_matrix=matrix)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--size', default='1920x1080')
    parser.add_argument('--poses', type=int, default=15)
    parser.add_argument('--rendered', type=int, default=2)
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split('x'))
    shipped = read_rig(config_folder() / 'rig.yaml')
    lenses = (scaled(lens, width, height) for lens in (shipped.camera, shipped.projector))
    rig = Rig(*lenses, shipped.rotation, shipped.translation)
    rng = np.random.default_rng(1)
    distances = rng.choice([0.6, 0.72, 0.9], arguments.poses)
    poses = [random_pose(BOARD, rig, distance, rng) for distance in distances]
    sequence = Sequence(width, height)
    light = Photometry(reference_distance=0.7, read_noise=1.5)
    taken = photographs(rig, BOARD, sequence, poses[: arguments.rendered], light)
    begin = time.process_time()
    for index, each in enumerate(taken):
        observe(f'pose_{index}', each, sequence, BOARD)
    reading = (time.process_time() - begin) / len(taken) * len(poses)
    seen = []
    for index, pose in enumerate(poses):
        camera, projector = true_correspondences(BOARD, rig, pose)
        camera = camera + rng.normal(0, _NOISE, camera.shape)
        projector = projector + rng.normal(0, _NOISE, projector.shape)
        seen.append(Observation(f'pose_{index}', camera, projector))
    steps: list[str] = []
    begin = time.process_time()
    solve(seen, BOARD, (width, height), (width, height), progress=steps.append)
    solving = time.process_time() - begin
    print(
        f'{len(poses)} poses of {len(sequence.frames)} photographs at {arguments.size}: reading '
        f'{reading:.1f} s ({len(taken)} poses measured), solving {solving:.1f} s in {len(steps)} '
        f'steps of at most {STEPS}; together {reading + solving:.1f} s of processor time'
    )


if __name__ == '__main__':
    main()
