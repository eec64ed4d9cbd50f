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

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.process import keep_freed
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.simulation import Dent, Surface
from ftp_dent_ros.simulation.dents import Gaussian


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--repetitions', type=int, default=15)
    repetitions = parser.parse_args().repetitions
    cv2.setNumThreads(1)
    # As the nodes and the commands do.
    keep_freed()
    one = scene_at(1280, 720)
    image = one.photograph()
    reconstructor = Reconstructor(one.rig, PATTERN, Settings(stride=2))
    measured = reconstructor.measure(image)
    bare = replace(one, panels=tuple(replace(panel, dents=()) for panel in one.panels))
    without = reconstructor.measure(bare.photograph())
    dent = Dent(0.02, 0.01, 0.05, 0.04, 0.001)
    synthetic, _ = cloud_of(Surface((skin(0.8, dents=(dent,)),)), 1e-5, np.random.default_rng(0))
    clouds = {
        'fuselage, 2 dents, 50 rivets': measured.cloud,
        'the same without dents': without.cloud,
        'flat, 1 dent, noise unknown': synthetic,
        'flat, 30 dents of hail': hailed(),
    }
    depth = np.nan_to_num(synthetic.points[..., 2])
    work = {'rfft2 of the depths': lambda: scipy.fft.rfft2(depth)}
    for name, cloud in clouds.items():
        work[name] = lambda cloud=cloud: inspect(cloud)
    taken = durations(work, repetitions, time.process_time)
    print(f'{measured.cloud.points.shape[:2]} points, median of {repetitions}')
    show(taken)


def hailed() -> Cloud:
    """Skin with 30 dents, 18 x 16 mm, in rows."""
    dents = tuple(
        Dent(0.09 * i - 0.225, 0.06 * j - 0.12, 0.018, 0.016, 4e-4, 0.0, Gaussian())
        for i in range(6)
        for j in range(5)
    )
    cloud, _ = cloud_of(Surface((skin(0.8, dents=dents),)), 3e-6, np.random.default_rng(0))
    return cloud


if __name__ == '__main__':
    main()
