"""A bag says which rig measured its clouds, and what of the skin they leave out."""

from __future__ import annotations

from bag_samples import DIAGNOSTICS, START_NS, diagnostics

from ftp_dent_ros.cloud.coverage import UNTIED, Coverage
from ftp_dent_ros.recording.clouds import NOTED_STAMP, coverages_of, rig_id_of
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.recording.writer import BagWriter


def test_the_diagnostics_tell_the_rig(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(DIAGNOSTICS)
        writer.write([diagnostics(0, rig='none'), diagnostics(1, rig='ba9876543210')])
    assert rig_id_of(open_bag(tmp_path / 'bag')) == 'ba9876543210'


def test_the_diagnostics_tell_what_of_the_lit_skin_has_no_points(tmp_path):
    untied = Coverage({UNTIED: 0.53})
    told = diagnostics(1, **untied.notes, **{NOTED_STAMP: str(START_NS)})
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(DIAGNOSTICS)
        writer.write([diagnostics(0, rig='none'), told])
    assert coverages_of(open_bag(tmp_path / 'bag')) == {START_NS: untied}
