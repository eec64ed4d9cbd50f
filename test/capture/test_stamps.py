from __future__ import annotations

import pytest

from ftp_dent_ros.capture.source import ExposureClock, stamps_exposure_start

MONOTONIC = 5_000_000_000_000
ROS = 1_763_000_000_000_000_000
MILLISECOND = 1_000_000


@pytest.mark.parametrize(
    ('clock', 'middle_ms'),
    [
        (ExposureClock(), -30),
        (ExposureClock(exposure=0.010), -35),
        (ExposureClock(exposure=0.010, at_start=True), -25),
        (ExposureClock(exposure=0.010, at_start=True, offset=-0.002), -27),
    ],
)
def test_a_buffer_is_stamped_with_the_middle_of_its_exposure(clock, middle_ms):
    buffer_ms = MONOTONIC / 1e6 - 30
    stamp, from_kernel = clock.stamp_ns(buffer_ms, MONOTONIC, ROS)
    assert from_kernel and abs(stamp - (ROS + middle_ms * MILLISECOND)) < 1000


@pytest.mark.parametrize(
    'buffer_ms',
    [
        0.0,
        33.4,
        MONOTONIC / 1e6 - 1500,
        MONOTONIC / 1e6 + 40,
        ROS / 1e6,
        -1.0,
    ],
)
def test_an_implausible_time_is_not_believed(buffer_ms):
    clock = ExposureClock(exposure=0.010, at_start=True)
    assert clock.stamp_ns(buffer_ms, MONOTONIC, ROS) == (ROS - 5 * MILLISECOND, False)


def test_a_device_without_a_driver_stamps_the_end():
    assert not stamps_exposure_start('/dev/video99')
