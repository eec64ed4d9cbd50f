"""What a photograph of another projected image must show."""

import numpy as np

from ftp_dent_ros.ros.photographer import changed


def photograph(level: float, rng: np.random.Generator, part: slice = slice(0, 0)) -> np.ndarray:
    """A view with the noise of a dim photograph, a part of it lit more."""
    light = np.full((120, 200), level)
    light[40:60, part] += 12
    return np.clip(light + rng.normal(0, 3, light.shape), 0, 255).astype(np.uint8)


def test_noise_is_no_change_and_another_light_on_a_hundredth_of_the_view_is():
    rng = np.random.default_rng(1)
    before = photograph(90, rng)
    assert not any(changed(before, photograph(90, rng)) for _ in range(50))
    assert all(changed(before, photograph(90, rng, slice(50, 70))) for _ in range(50))
