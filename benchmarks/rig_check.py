"""Field check: false alarms on good rigs, and which drifts it detects, on rendered walls.

python benchmarks/rig_check.py [--walls 100]
"""

from __future__ import annotations

import argparse

import numpy as np
from tqdm import tqdm

from ftp_dent_ros.calibration.checking import _turned, check
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig import read_rig
from ftp_dent_ros.simulation import Panel, Photometry, Surface, render

# Standard deviation of the border of a wall off the plane of its middle, metres.
_FLATNESS = 2e-5
_DRIFT = 0.05  # degrees


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--walls', type=int, default=100)
    parser.add_argument('--first', type=int, default=1000)
    arguments = parser.parse_args()
    rig = read_rig(config_folder() / 'rig.yaml')
    pattern = read_pattern(config_folder() / 'pattern.yaml')
    alarms, missed, normalised = 0, np.zeros(3), []
    for seed in tqdm(range(arguments.first, arguments.first + arguments.walls), unit='wall'):
        rng = np.random.default_rng(seed)
        distance = rng.uniform(0.6, 1.0)
        pose = Pose.from_rpy(rng.uniform(-0.15, 0.15, 3), (0, 0, distance))
        sag = max(abs(rng.normal(0, _FLATNESS)), 1e-7)
        radius = (0.33 * distance) ** 2 / (2 * sag)
        panel = Panel(pose, (-1, 1, -1, 1), cylinder_radius=radius)
        light = Photometry(
            reference_distance=distance,
            exposure=rng.uniform(0.5, 0.95),
            ambient=rng.uniform(0, 0.1),
            read_noise=rng.uniform(0.8, 2.5),
            defocus_px=rng.uniform(0.6, 1.6),
            projector_gamma=rng.uniform(1, 2.2),
        )
        image = render(rig, pattern.draw(), Surface((panel,)), light, rng)

        def seen(by, image=image):
            points = Reconstructor(by, pattern, Settings(stride=4)).measure(image).cloud.points
            return check(by, pattern, image, points, _FLATNESS)

        good = seen(rig)
        alarms += not good.holds
        normalised.append(good.turn / good.deviation)
        axis = seed % 3
        turn = np.zeros(3)
        turn[axis] = np.radians(_DRIFT) * rng.choice([-1, 1])
        missed[axis] += seen(_turned(rig, turn)).holds
    print(f'{alarms} false alarms in {arguments.walls} good walls')
    spread = ', '.join(f'{x:.2f}' for x in np.sqrt(np.mean(np.square(normalised), axis=0)))
    print(f'normalised turns, rms: {spread}')
    each = ', '.join(f'{count:.0f}' for count in missed)
    print(f'missed of {_DRIFT} degrees of pitch, yaw, roll: {each} of {arguments.walls // 3} each')


if __name__ == '__main__':
    main()
