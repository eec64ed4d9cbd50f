"""Seconds a photograph takes, method by method, beside a Fourier transform of the same frame.

OPENBLAS_NUM_THREADS=1 python benchmarks/reconstruction_speed.py [--repetitions 15]
                                                                 [--code contrast]

Processor time of one thread. The yardstick is one scipy.fft.rfft and irfft of the rows, float32,
one worker, measured in turn with each method, so that what else the machine does falls on both
alike. Memory is kept as nodes and commands keep it.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import product

import cv2
import numpy as np
import scipy.fft
from scenes import FIELD, PATTERN, Scene, fuselage, scene
from timing import durations, show

from ftp_dent_ros.pattern.pattern import CODES
from ftp_dent_ros.process import keep_freed
from ftp_dent_ros.profilometry import METHODS, Reconstructor, Settings
from ftp_dent_ros.rig.rig import Lens

SIZES = ((1280, 720), (1920, 1080))
STRIDES = (1, 2)


def scene_at(width: int, height: int) -> Scene:
    """The fuselage, which fills the frame, before a camera of that size."""
    lens = FIELD.camera
    share = width / lens.width
    matrix = lens.camera_matrix.copy()
    matrix[:2] *= share
    camera = Lens(width, height, matrix, np.array([-0.08, 0.03, 5e-4, -5e-4, 0.0]))
    return scene(f'{width}x{height}', replace(FIELD, camera=camera), fuselage(0.8))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--repetitions', type=int, default=15)
    parser.add_argument('--code', choices=CODES, default=PATTERN.code, help='of the pattern')
    arguments = parser.parse_args()
    repetitions, pattern = arguments.repetitions, replace(PATTERN, code=arguments.code)
    methods = METHODS if pattern.code == 'stripe' else ['least-squares']
    cv2.setNumThreads(1)
    keep_freed()
    for size in SIZES:
        image = scene_at(*size).photograph(pattern=pattern)
        rows = image[..., 0].astype(np.float32)

        def transform(rows=rows):
            scipy.fft.irfft(scipy.fft.rfft(rows, workers=1), workers=1)

        print(f'{size[0]}x{size[1]}, median of {repetitions}')
        for method, stride in product(methods, STRIDES):
            rig = scene_at(*size).rig
            reconstructor = Reconstructor(rig, pattern, Settings.chosen(method, stride))
            name = f'{method}, stride {stride}'
            work = {
                'rfft + irfft of the frame': transform,
                name: lambda one=reconstructor, image=image: one.reconstruct(image),
            }
            show(durations(work, repetitions, time.process_time))


if __name__ == '__main__':
    main()
