"""Dents and inspections made by hand, and inspections that know the simulated truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Estimate, Inspection, MeasuredDent
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.simulation.dents import Dent
from ftp_dent_ros.simulation.surface import Panel, Surface
from ftp_dent_ros.simulation.truth import TrueDent, true_dents


def make_dent(
    position=(0.0, 0.0, 0.6),
    depth=2e-3,
    length=40e-3,
    width=30e-3,
    normal=(0.0, 0.0, -1.0),
    axis=(1.0, 0.0, 0.0),
    sigma=10e-6,
    kind='dent',
    is_cut=False,
):
    """A dent with the uncertainty `sigma` of its depth, and a hundred times that of its sizes."""
    position, normal, axis = (np.array(value, float) for value in (position, normal, axis))
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)[:, None]
    across = np.cross(normal, axis)
    outline = position + length / 2 * np.cos(angles) * axis + width / 2 * np.sin(angles) * across
    return MeasuredDent(
        kind=kind,
        position=position,
        normal=normal,
        axis=axis,
        depth=Estimate(depth, sigma),
        length=Estimate(length, 100 * sigma),
        width=Estimate(width, 100 * sigma),
        model_length=Estimate(length / 0.835, 100 * sigma),
        model_width=Estimate(width / 0.835, 100 * sigma),
        orientation=Estimate(0.1, 0.01),
        area=Estimate(np.pi / 4 * length * width, 1e-5),
        volume=Estimate(0.3 * depth * length * width, 1e-9),
        bottom_radius=width**2 / (8 * abs(depth)),
        significance=depth / sigma,
        is_cut=is_cut,
        outline=outline,
        length_profile=_profile(length, depth),
        width_profile=_profile(width, depth),
    )


def scattered(rng, count, low, high, apart):
    """Places between two corners, shape (count, 2), no two nearer to each other than so far."""
    places: list[np.ndarray] = []
    while len(places) < count:
        place = rng.uniform(low, high)
        if all(np.linalg.norm(place - other) > apart for other in places):
            places.append(place)
    return np.array(places)


def _profile(size, depth):
    at = np.linspace(-0.8, 0.8, 101) * size
    q = np.maximum(1 - (at / (size / 0.835 / 2)) ** 2, 1e-9)
    return np.stack([at, depth * np.exp(1 - 1 / q)], axis=-1)


def measured(true: TrueDent, sigma=10e-6):
    """The dent of the simulation as a perfect inspection would give it."""
    dent = make_dent(
        true.position, true.depth, true.length, true.width, true.normal, true.axis, sigma
    )
    return replace(dent, outline=true.outline)


class TrueInspector:
    """An `inspect` that takes what it finds from the simulated surface in the cloud's frame."""

    def __init__(self, surface: Surface, noise=8e-6):
        self.surface, self.noise = surface, noise
        self.bare = Surface(tuple(replace(panel, dents=()) for panel in surface.panels))

    def __call__(self, cloud, settings=None, viewpoint=(0.0, 0.0, 0.0)):
        deviation = self.bare.distance(cloud.points).astype(np.float32)
        centres = cloud.points[cloud.valid].astype(float)
        dents = [
            measured(true)
            for true in true_dents(self.surface)
            if len(centres) and np.linalg.norm(centres - true.position, axis=1).min() < 5e-3
        ]
        dents.sort(key=lambda dent: -dent.depth.value)
        return Inspection(
            tuple(dents),
            (),
            (),
            deviation,
            np.full_like(deviation, self.noise),
            np.full_like(deviation, 1e-4),
        )


CAMERA = Lens(320, 240, np.array([[400.0, 0, 159.5], [0, 400, 119.5], [0, 0, 1]]), np.zeros(5))
DENTED = Surface(
    (
        Panel(
            pose=Pose.from_rpy((0, 0.05, 0), (0, 0, 0.6)),
            extent=(-1, 1, -1, 1),
            cylinder_radius=2.0,
            dents=(Dent(0.0, 0.0, 0.08, 0.06, 0.002), Dent(0.13, 0.05, 0.05, 0.04, 0.001, 0.3)),
        ),
    )
)


def noisy_cloud(surface=DENTED, seed=1, sigma=8e-6):
    """Cloud of `CAMERA` on a surface in its frame, with noise along the rays."""
    rays = CAMERA.rays(CAMERA.pixel_grid())
    depth = surface.intersect(rays)
    depth = depth + sigma * np.random.default_rng(seed).standard_normal(depth.shape)
    points = (rays * depth[..., None]).astype(np.float32)
    return Cloud(points, np.ones(depth.shape, np.float32))
