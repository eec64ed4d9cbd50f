"""What a scene file can ask for, as the skin that comes of it."""

import numpy as np
import pytest
import yaml

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.simulation.world import read_world
from ftp_dent_ros.yaml_file import read_yaml


@pytest.fixture
def world_of(tmp_path):
    """The world of the shipped scene with other panels before the camera, and photometry."""

    def build(panels, **photometry):
        scene = read_yaml(find('shipped:scene.yaml'), ConfigurationError)
        scene['panels'] = panels
        scene['photometry'] = photometry
        scene['flight'] |= {
            'middle': {'translation': [-0.7, 0, 0], 'rpy': [0, 0, 0]},
            'length': 1e-6,
            'sway': [0, 0, 0],
            'wobble': [0, 0, 0],
        }
        file = tmp_path / 'scene.yaml'
        file.write_text(yaml.safe_dump(scene))
        return read_world(file)

    return build


def panel(distance=0.0, extent=(-0.5, 0.5, -0.5, 0.5), **fields):
    """A flat panel 0.6 m before the camera: its x is the image's x, its y the image's y."""
    pose = {'translation': [distance, 0, 0], 'rpy': [-np.pi / 2, 0, -np.pi / 2]}
    return {'pose': pose, 'extent': list(extent), **fields}


def depth(world, x, y=0.0):
    """Depth before the camera along rays through points 0.6 m away."""
    x, y = np.broadcast_arrays(x, y)
    rays = np.stack([np.divide(x, 0.6), np.divide(y, 0.6), np.ones(x.shape)], axis=-1)
    return world.seen_surface(0).intersect(rays)


def test_a_dent_is_pushed_in_and_a_bump_stands_out(world_of):
    dents = [
        {'x': -0.05, 'y': 0, 'length': 0.04, 'width': 0.04, 'depth': 0.002},
        {'x': 0.05, 'y': 0, 'length': 0.04, 'width': 0.04, 'depth': -0.001},
    ]
    world = world_of([panel(dents=dents)])
    # A ray meets the deeper skin a little further out.
    np.testing.assert_allclose(depth(world, [0, -0.05, 0.05]), [0.6, 0.602, 0.599], atol=2e-6)


def test_a_lap_joint_is_a_step_of_a_sheet(world_of):
    lap = [panel(extent=(-0.5, 0.01, -0.5, 0.5)), panel(0.0016, extent=(-0.02, 0.5, -0.5, 0.5))]
    world = world_of(lap)
    np.testing.assert_allclose(depth(world, [0.009, 0.011]), [0.6, 0.6016], atol=1e-9)


def test_rivets_stand_in_a_row_of_equal_steps(world_of):
    row = {'first': [-0.02, 0.01], 'step': [0.02, 0.0], 'count': 3, 'radius': 0.003}
    world = world_of([panel(rivet_rows=[row])])
    rivets = world.surface.panels[0].rivets
    np.testing.assert_allclose(
        [(r.x, r.y) for r in rivets], [(-0.02, 0.01), (0, 0.01), (0.02, 0.01)]
    )
    assert {(r.radius, r.groove, r.sigma) for r in rivets} == {(0.003, 80e-6, 250e-6)}


def test_skins_marks_fittings_and_shapes_by_their_names(world_of):
    """Each part is what its class says, and a wrong field is named with its place."""
    place = {'x': 0.0, 'y': 0.0}
    size = {'length': 0.04, 'width': 0.01}
    names = 'smooth', 'cosine', 'gaussian', 'cap', 'flat', 'crater', 'oil_can', 'crease', 'gouge'
    marks = [
        {'kind': 'dirt', 'contrast': 0.2, 'scales': [0.02, 0.005], 'seed': 3},
        {'kind': 'patch', 'tint': 0.5, 'round': True, **place, **size},
        {'kind': 'lettering', 'text': 'NO STEP', 'height': 0.02, 'tint': [1, 0.2, 0.2], **place},
        {'kind': 'scratches', 'count': 4, 'extent': [-0.1, 0.1, -0.1, 0.1]},
    ]
    fields = {
        'dents': [{'shape': name, 'depth': 0.0005, **place, **size} for name in names],
        'paint': {'albedo': 0.7, 'marks': marks},
        'waves': [{'amplitude': 0.0001, 'wavelength': 0.1}],
        'sunlight': [{'level': 0.5, 'edge': [1, 0, 0], 'softness': 0.004}],
        'rivet_rows': [
            {'kind': kind, 'first': [0, 0], 'step': [0.02, 0], 'count': 2}
            for kind in ('flush', 'domed')
        ],
    }
    (skin,) = world_of([panel(**fields)]).surface.panels
    assert len({type(dent.shape) for dent in skin.dents}) == 8
    assert [dent.kind for dent in skin.dents[-2:]] == ['crease', 'gouge']
    assert len(skin.paint.marks) == 7
    assert len(skin.rivets) == 4
    assert (len(skin.waves), len(skin.sunlight)) == (1, 1)
    fields['paint']['marks'][0]['contrast'] = 'much'
    with pytest.raises(ConfigurationError, match=r"marks\[0\].contrast is 'much': give a finite"):
        world_of([panel(**fields)])
    with pytest.raises(ConfigurationError, match=r"shape is 'star': give one of smooth, cosine"):
        world_of([panel(dents=[{'shape': 'star', 'depth': 0.001, **place, **size}])])
