"""How long things take, in multiples of one rfft and irfft of the photograph's rows.

Processor time of one thread, the least of several, each in turn with the yardstick: what else the
machine does only adds to it. Memory is kept as nodes and commands keep it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import scipy.fft
from measures import PAPERS_METHOD, generator
from photographs import KINDS, STRIDE
from surveys import STATED, flight, marked_skin, seen_from

from ftp_dent_ros import inspect
from ftp_dent_ros.pattern.pattern import CODES
from ftp_dent_ros.process import keep_freed
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.survey.patch import patch_of
from ftp_dent_ros.survey.registration import register

REPETITIONS = 15


def speeds(seed: int) -> dict[str, float]:
    """Multiples, by what is done."""
    cv2.setNumThreads(1)
    keep_freed()
    work: dict[str, Callable[[], Any]] = {}
    clean = KINDS['clean'](generator(seed, 0, 'speeds'))
    for code in CODES:
        one = clean.under(code)
        image = one.photograph(generator(seed, 0, code)).shown()
        for method in (Settings().method, *((PAPERS_METHOD,) if code == 'stripe' else ())):
            settings = Settings(method, stride=STRIDE)
            measure = Reconstructor(one.rig, one.pattern, settings).measure
            name = f'reconstruct, {code}, {method}'
            work[name] = lambda measure=measure, image=image: measure(image, True)
            if method == Settings().method:
                cloud = measure(image, True).cloud
                work[f'inspect, {code}'] = lambda cloud=cloud: inspect(cloud)
    rng = generator(seed, 0, 'pair')
    poses, panel = flight(rng, 2), marked_skin(rng, 0.3)
    first, second = (patch_of(seen_from(pose, panel, 'stripe', rng)) for pose in poses)
    guess = poses[0].inverse() @ poses[1]
    work['register a pair of clouds'] = lambda: register(first, second, guess, STATED / 4)
    rows = image[..., 0].astype(np.float32)

    def yardstick() -> None:
        scipy.fft.irfft(scipy.fft.rfft(rows, workers=1), workers=1)

    return {name: _multiple(each, yardstick) for name, each in work.items()}


def _multiple(work: Callable[[], Any], yardstick: Callable[[], Any]) -> float:
    taken: tuple[list[float], list[float]] = ([], [])
    for repetition in range(REPETITIONS + 1):
        for function, seconds in zip((work, yardstick), taken, strict=True):
            begin = time.process_time()
            function()
            # The first is to warm up.
            if repetition:
                seconds.append(time.process_time() - begin)
    return min(taken[0]) / min(taken[1])
