"""A bag says which rig measured its clouds, and what of the skin they leave out."""

from __future__ import annotations

from bag_samples import SECOND, START_NS, header, made, serialised, topic

from ftp_dent_ros.cloud.coverage import UNTIED, Coverage
from ftp_dent_ros.recording.clouds import NOTED_STAMP, coverages_of, rig_id_of
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagWriter

ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'
DIAGNOSTICS = topic('/diagnostics', ARRAY)


def diagnostics(seconds: int, **told: str) -> Message:
    values = [made('diagnostic_msgs/msg/KeyValue', name, value) for name, value in told.items()]
    status = made('diagnostic_msgs/msg/DiagnosticStatus', 0, 'reconstruction', '', '', values)
    data = serialised(ARRAY, header(SECOND * seconds, ''), [status])
    time_ns = START_NS + seconds
    return Message('/diagnostics', ARRAY, time_ns, time_ns, data, seconds)


def test_the_metadata_tell_it_first(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(DIAGNOSTICS)
        writer.write([diagnostics(0, rig='of-diagnostics')])
        writer.custom_data['rig'] = '0123456789ab'
    bag = open_bag(tmp_path / 'bag')
    assert bag.custom_data == {'rig': '0123456789ab'}
    assert rig_id_of(bag) == '0123456789ab'


def test_the_diagnostics_tell_it_where_the_recorder_was_killed(tmp_path):
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
