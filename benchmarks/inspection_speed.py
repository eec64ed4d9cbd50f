"""Time from a cloud to its dents, beside a Fourier transform of as many points.

python benchmarks/inspection_speed.py [--repetitions 15]

Clouds of photographs of 1280 x 720 at stride 2; processor time of one thread. The yardstick is
scipy.fft.rfft2 of the depths, float32, one worker, measured in turn with the rest, so that what
else the machine does falls on all of them alike.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import cv2
import numpy as np
import scipy.fft
from clouds import cloud_of, skin
from reconstruction_speed import scene_at
from scenes import PATTERN
from timing import durations, show

from ftp_dent_ros.inspection.inspection import inspect
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.simulation import Dent, Surface


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--repetitions', type=int, default=15)
    repetitions = parser.parse_args().repetitions
    cv2.setNumThreads(1)
    one = scene_at(1280, 720)
    image = one.photograph()
    reconstructor = Reconstructor(one.rig, PATTERN, Settings(stride=2))
    measured = reconstructor.measure(image)
    bare = replace(one, panels=tuple(replace(panel, dents=()) for panel in one.panels))
    without = reconstructor.measure(bare.photograph())
    dent = Dent(0.02, 0.01, 0.05, 0.04, 0.001)
    synthetic, _ = cloud_of(Surface((skin(0.8, dents=(dent,)),)), 1e-5, np.random.default_rng(0))
    clouds = {
        'fuselage, 2 dents, 50 rivets': (measured.cloud, deviation_of(measured)),
        'the same without dents': (without.cloud, deviation_of(without)),
        'flat, 1 dent, noise unknown': (synthetic, None),
    }
    depth = np.nan_to_num(synthetic.points[..., 2])
    work = {'rfft2 of the depths': lambda: scipy.fft.rfft2(depth)}
    for name, (cloud, noise) in clouds.items():
        work[name] = lambda cloud=cloud, noise=noise: inspect(cloud, noise)
    taken = durations(work, repetitions, time.process_time)
    print(f'{measured.cloud.points.shape[:2]} points, median of {repetitions}')
    show(taken)


def deviation_of(measurement) -> np.ndarray:
    return measurement.quality.standard_deviation()


if __name__ == '__main__':
    main()
