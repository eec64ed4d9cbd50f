from __future__ import annotations

import time
from itertools import count

import numpy as np
import pytest

from ftp_dent_ros.capture.source import RenderedSource, SimulatedSource, write_rendered
from ftp_dent_ros.errors import CameraError, ImageError
from ftp_dent_ros.photograph.photograph import Photograph


def photograph(projected, stamp_ns):
    if projected.shape != (2, 2, 3):
        raise ImageError('the projected image has the wrong size')
    return Photograph(projected + np.uint8(stamp_ns % 256))


def source(rate=0.0):
    return SimulatedSource(photograph, rate, count(1000).__next__)


def test_without_a_pattern_or_with_one_of_another_size_there_is_no_photograph():
    camera = source()
    with pytest.raises(CameraError, match='start pattern_publisher'):
        camera.shoot()
    camera.project(np.zeros((3, 2, 3), np.uint8), 0)
    with pytest.raises(ImageError, match='wrong size'):
        camera.shoot()


def test_frames_fall_due_at_the_rate():
    camera = source(rate=0.001)
    camera.project(np.zeros((2, 2, 3), np.uint8), -(10**12))
    assert camera.next_frame(0.0) is not None
    assert camera.next_frame(0.0) is None
    assert camera.notes() == {'missed': 0}


def test_a_photograph_that_is_computed_late_shows_what_was_projected_when_it_was_taken():
    camera = source()
    camera.project(np.full((2, 2, 3), 1, np.uint8), 900)
    camera.project(np.full((2, 2, 3), 7, np.uint8), 1001)
    assert camera.shoot().photograph.pixels[0, 0, 0] == np.uint8(1 + 1000 % 256), (
        'not yet the next one'
    )
    camera.project(np.full((2, 2, 3), 3, np.uint8), 950)
    assert camera.shoot().photograph.pixels[0, 0, 0] == np.uint8(7 + 1001 % 256), (
        'by stamp, not by arrival'
    )


def test_photographs_that_were_rendered_ahead_are_taken_at_their_own_times(tmp_path):
    for number in range(4):
        write_rendered(tmp_path, number, Photograph(np.full((2, 3, 3), number, np.uint8)))
    start_ns = time.time_ns() + 50_000_000
    source = RenderedSource(tmp_path, 20.0, start_ns, time.time_ns)
    source.rest()
    taken = []
    while not source.finished:
        frame = source.next_frame(0.02)
        if frame is not None:
            assert time.time_ns() >= frame.stamp_ns
            taken.append((frame.stamp_ns - start_ns, int(frame.photograph.pixels[0, 0, 0])))
            if len(taken) == 2:
                time.sleep(0.12)  # a node that is busy misses one
    assert taken[:2] == [(0, 0), (50_000_000, 1)] and taken[-1] == (150_000_000, 3)
    assert source.missed == 4 - len(taken)
