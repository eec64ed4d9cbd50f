"""Dents counted under poses that err, and a list that outlives its process."""

import numpy as np
import pytest
from dent_samples import make_dent, scattered
from scipy.spatial.transform import Rotation

from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.dents.kept_list import KeptList
from ftp_dent_ros.errors import ConfigurationError, PoseError
from ftp_dent_ros.pose import Pose

COVARIANCE = np.diag([0.025**2] * 3 + [np.radians(0.6) ** 2] * 3)
SAME = Pose.from_rpy((0, 0, 0), (0, 0, 0))


@pytest.mark.parametrize('seed', [1, 2])
def test_hail_is_counted_exactly_though_poses_err_by_centimetres_and_a_degree(seed):
    rng = np.random.default_rng(seed)
    places = scattered(np.random.default_rng(seed), 45, (0, 0), (0.9, 0.5), 0.02)
    depths = rng.uniform(1.5e-4, 6e-4, len(places))
    dents = DentList()
    seen = set()
    way = [(x, y) for y, to in ((0.15, 1), (0.35, -1)) for x in np.linspace(0.25, 0.65, 6)[::to]]
    for frame, (x, y) in enumerate(way):
        at, shift = np.array([x, y, 0.8]), rng.normal(0, 0.025, 3)
        turn = Rotation.from_rotvec(rng.normal(0, np.radians(0.6), 3))
        shown = []
        for index in np.flatnonzero((np.abs(places - at[:2]) < (0.24, 0.14)).all(axis=1)):
            place = np.array([*places[index], 0]) + rng.normal(0, 2e-4, 3)
            moved = at + shift + turn.apply(place - at)
            depth = depths[index] * (1 + rng.normal(0, 0.01))
            shown.append(make_dent(moved, depth, 18e-3, 16e-3, (0.0, 0.0, 1.0), sigma=4e-6))
            seen.add(int(index))
        dents.add(frame, shown, Pose(Rotation.identity(), at + shift), COVARIANCE)
    entries = dents.entries
    assert len(entries) == len(seen)
    for entry in entries:
        values = [sighting.dent.depth.value for sighting in entry.sightings]
        assert np.ptp(values) < 0.1 * np.mean(values)
    # Between them they lie as they do, wherever the poses have put them all.
    found = np.array([entry.dent.position[:2] for entry in entries])
    true = places[sorted(seen)]
    assert np.linalg.norm(found.mean(axis=0) - true.mean(axis=0)) < 0.03


def test_a_list_is_there_again_after_a_restart(tmp_path):
    path = tmp_path / 'list' / 'dents.jsonl'
    kept = KeptList(path)
    kept.add('map', 1, [make_dent(), make_dent((0.2, 0, 0.6), kind='crease')], SAME, COVARIANCE)
    kept.add('map', 2, [make_dent((0.004, 0, 0.6))], SAME, COVARIANCE)

    again = KeptList(path)

    assert (again.frame_id, again.clouds, again.stamp_ns) == ('map', 2, 2)
    for one, other in zip(kept.entries, again.entries, strict=True):
        assert one.number == other.number and one.dent.kind == other.dent.kind
        assert one.dent.depth == other.dent.depth
        np.testing.assert_array_equal(one.dent.position, other.dent.position)
        assert len(one.sightings) == len(other.sightings)
    again.clear()
    assert KeptList(path).entries == ()


def a_loop(frames=20):
    """Stamps, true and drifted poses, and dents in the cameras' frames: there and back."""
    rng = np.random.default_rng(5)
    places = np.column_stack([rng.uniform(0, 3, 30), rng.uniform(-0.1, 0.1, 30), np.zeros(30)])
    way = np.concatenate([np.linspace(0, 2.8, frames // 2), np.linspace(2.8, 0, frames // 2)])
    for frame, x in enumerate(way):
        true = Pose.from_rpy((0, 0, 0), (x, 0, 0.8))
        # Ever farther off, beyond what is stated at the end.
        said = Pose.from_rpy((0, 0, 0), (x, 0.012 * frame, 0.8))
        near = np.abs(places[:, 0] - x) < 0.12
        dents = [make_dent(at, 1e-3 + 1e-4 * i) for i, at in enumerate(places) if near[i]]
        yield frame + 1, true, said, [dent.transformed(true.inverse()) for dent in dents]


def test_a_corrected_list_is_the_one_that_right_poses_make_and_keeps_its_numbers(tmp_path):
    tight = np.diag([2e-3**2] * 3 + [1e-3**2] * 3)
    path = tmp_path / 'dents.jsonl'
    drifted, right = KeptList(path), KeptList()
    poses = {}
    for stamp, true, said, dents in a_loop():
        drifted.add('map', stamp, [each.transformed(said) for each in dents], said, tight)
        right.add('map', stamp, [each.transformed(true) for each in dents], true, tight)
        poses[stamp] = true
    before = {entry.number for entry in drifted.entries}
    assert len(before) > len(right.entries)
    with pytest.raises(PoseError, match='odom'):
        drifted.correct('odom', poses)

    assert drifted.correct('map', poses | {99: SAME})

    for kept in (drifted, KeptList(path)):
        for one, other in zip(kept.entries, right.entries, strict=True):
            np.testing.assert_allclose(one.dent.position, other.dent.position, atol=1e-9)
            assert len(one.sightings) == len(other.sightings)
    # Those that are one after all have the number of the first.
    assert [entry.number for entry in drifted.entries] == sorted(
        {entry.number for entry in drifted.entries}
    )
    assert {entry.number for entry in drifted.entries} < before
    assert not drifted.correct('map', poses)
    # A last cloud that is moved a little costs no others their place.
    last = {20: Pose.from_rpy((0, 0, 0), (0, 0.002, 0.8))}
    assert drifted.correct('map', last) and not drifted.correct('map', last)
    drifted.clear()
    assert drifted.entries == () == KeptList(path).entries
    drifted.add('map', 1, [make_dent()], SAME, COVARIANCE)
    assert [entry.number for entry in drifted.entries] == [1]


def test_what_a_crash_cut_short_is_left_out(tmp_path):
    path = tmp_path / 'dents.jsonl'
    KeptList(path).add('map', 1, [make_dent()], SAME, COVARIANCE)
    whole = path.read_bytes()
    path.write_bytes(whole + whole[:100])
    assert KeptList(path).clouds == 1
    KeptList(path).add('map', 2, [make_dent()], SAME, COVARIANCE)
    assert KeptList(path).clouds == 2


def test_no_other_frame_clears_it():
    kept = KeptList()
    kept.add('map', 1, [make_dent()], SAME, COVARIANCE)
    for frame_id, stamp_ns, said in (('odom', 2, 'odom'), ('map', 1, 'already')):
        with pytest.raises(PoseError, match=said):
            kept.add(frame_id, stamp_ns, [make_dent()], SAME, COVARIANCE)
    assert (len(kept.entries), kept.clouds, kept.frame_id) == (1, 1, 'map')


@pytest.mark.parametrize('text', ['buy milk\n', '[{}]', 'buy milk\nand bread'])
def test_a_file_of_something_else_is_named_and_left_as_it_is(tmp_path, text):
    path = tmp_path / 'notes.txt'
    path.write_text(text)
    with pytest.raises(ConfigurationError, match='line 1 is no entry'):
        KeptList(path)
    assert path.read_text() == text
    with pytest.raises(ConfigurationError, match='cannot be kept'):
        KeptList(tmp_path)
