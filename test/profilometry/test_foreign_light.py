"""What lies before the skin, and colours that the projector does not bring into register."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from small_scenes import DENT, DEPTH, PATTERN, RIG, Scene, panel

from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor
from ftp_dent_ros.simulation import Paint


def net():
    """A photograph of a skin, through meshes of 60 pixels of cords of 3."""
    pose = Pose.from_rpy((0.0, 0.05, 0.0), (0.0, 0.0, DEPTH - 0.08))
    skin = panel(dents=(), half=0.2)
    behind, before = (Scene.of(each).image for each in (skin, replace(skin, pose=pose)))
    v, u = np.indices(behind.shape[:2])
    on = np.minimum((u + 0.8 * v) % 61, (u - 1.1 * v) % 67) < 3
    return np.where(on[..., None], before, behind)


@pytest.mark.xfail(reason='three are listed; with OpenCV 4.6 two')
def test_cords_before_a_skin_are_in_doubt():
    found = inspect(Reconstructor(RIG, PATTERN).reconstruct(net()))
    named = [each for each in (*found.dents, *found.others) if each.kind not in ('other', 'step')]
    # A dozen, were sigma that of a skin.
    assert len(named) <= 2


def apart(image, ways):
    """A projector's image, each colour a little larger than the one before."""
    v, u = np.indices(image.shape[:2], np.float32)
    # Cubics and 1/32 of a pixel, as OpenCV has them, move fringes by 0.01 pixels.
    layers = [
        map_coordinates(layer.astype(np.float32), (v, u + way * (u - 319.5)), mode='nearest')
        for way, layer in zip(ways, cv2.split(image), strict=True)
    ]
    return np.clip(np.rint(np.dstack(layers)), 0, 255).astype(np.uint8)


PAINT = Paint((0.8, 0.8, 0.8), (0.7, 0.714, 0.01), (0.6, 0.06, 0.05))
# White light's fringes, by the weights that colours have in it, stay where they are.
WAYS = -0.00294, 0.0015, 0.0


def error_on_red(scene, image):
    """Median error on red paint, mm."""
    cloud = Reconstructor(RIG, PATTERN).reconstruct(image)
    red = image[..., 0] > 3.0 * image[..., 1]
    red = cv2.blur(red.astype(np.float32), (25, 25)) > 0.5
    return np.median(scene.errors_mm(cloud)[red[cloud.valid]])


def test_paint_is_measured_by_fringes_of_its_own_colour():
    image = apart(PATTERN.draw(), WAYS)
    scene = Scene.of(panel(half=0.2, paint=PAINT, dents=(DENT,)), projected=image)
    # By red's own fringes, 0.6 mm.
    assert error_on_red(scene, scene.image) < 0.06


def test_the_cameras_colours_lie_apart_by_the_cameras_own_frame():
    pose = Pose.from_rpy((0.0, -0.35, 0.0), (0.0, 0.0, DEPTH))
    scene = Scene.of(replace(panel(half=0.2, paint=PAINT), pose=pose))
    # By the projector's frame without terms of second order, 0.042 mm.
    assert error_on_red(scene, apart(scene.image, WAYS)) < 0.025
