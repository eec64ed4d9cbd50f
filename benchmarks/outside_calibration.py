"""A rig as its calibration with the projector that it has would leave it: the principal point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from outside_renderer import World, photograph
from outside_sensors import develop

from ftp_dent_ros.profilometry import Reconstructor
from ftp_dent_ros.rig.rig import Rig


def calibrated(world: World, seed: int) -> Rig:
    """The world's rig, its projector's principal column by one photograph of a plain panel.

    Parameters
    ----------
    world : World
        Of which the projector, the rig and the pattern are taken.
    seed : int
        Of the photograph's noise.
    """
    rig = world.rig
    plain = World(slide=world.slide, lamp=world.lamp, pattern=world.pattern, rig=rig, exposure=0.9)
    picture = develop(photograph(plain), np.random.default_rng(seed))
    cloud = Reconstructor(rig, world.pattern).reconstruct(picture)
    points = cloud.points[cloud.valid].astype(float)
    rays = points / points[:, 2:]
    true = rays * plain.meet(rays)[:, None]
    column, expected = (
        rig.projector.project(rig.to_projector(each))[:, 0] for each in (points, true)
    )
    matrix = rig.projector.camera_matrix.copy()
    matrix[0, 2] += np.nanmedian(column - expected)
    return replace(rig, projector=replace(rig.projector, camera_matrix=matrix))
