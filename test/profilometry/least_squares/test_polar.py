import numpy as np

from ftp_dent_ros.profilometry.least_squares.fit.polar import angle, magnitude


def test_angles_are_those_of_the_library():
    turns = np.linspace(-np.pi, np.pi, 100_001)
    for amplitude in (1e-3, 1.0, 120.0):
        y = (amplitude * np.sin(turns)).astype(np.float32)
        x = (amplitude * np.cos(turns)).astype(np.float32)
        expected = np.arctan2(y.astype(float), x.astype(float))
        np.testing.assert_allclose(angle(y, x), expected, atol=5e-7)
        np.testing.assert_allclose(magnitude(x, y), amplitude, rtol=1e-6)


def test_axes_and_nothing_have_angles():
    y = np.array([0, 0, 3, -3, 0], np.float32)
    x = np.array([0, 2, 0, 0, -2], np.float32)
    np.testing.assert_allclose(angle(y, x), np.arctan2(y, x), atol=5e-7)
