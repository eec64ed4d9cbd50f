from __future__ import annotations

from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Statistics


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def values_of(status):
    return {item.key: item.value for item in status.values}


def test_counts_durations_and_notes_are_shown(ros, monkeypatch):
    monkeypatch.setattr('ftp_dent_ros.ros.diagnostics.Statistics', lambda: Statistics(now=Clock()))
    diagnostics = Diagnostics(ros.node, hardware_id='/dev/video0')
    for seconds in (0.010, 0.030, 0.020):
        diagnostics.count('images')
        diagnostics.measure('latency', seconds)
    diagnostics.note('period (px)', 8)
    status = diagnostics.status()
    values = values_of(status)
    assert (status.level, status.message, status.hardware_id) == (OK, 'working', '/dev/video0')
    assert status.name == f'{ros.namespace}/tester'.lstrip('/')
    assert (values['images'], values['images per second']) == ('3', '3.00')
    assert values['latency median (ms)'] == '20.0'
    assert values['latency maximum (ms)'] == '30.0'
    assert (values['period (px)'], values['refused'], values['failed']) == ('8', '0', '0')


def test_a_refusal_warns_with_its_reason(ros):
    diagnostics = Diagnostics(ros.node)
    diagnostics.refuse('too dark', 'no fringes are seen: switch the lamp on')
    diagnostics.refuse('no stripe', 'the red stripe is not seen')
    diagnostics.refuse('no stripe', 'the red stripe is not seen')
    status = diagnostics.status()
    values = values_of(status)
    assert status.level == WARN
    assert status.message == '3 refused in 10 s, last no stripe: the red stripe is not seen'
    assert (values['refused: no stripe'], values['refused: too dark']) == ('2', '1')


def test_what_is_dropped_warns_too(ros):
    diagnostics = Diagnostics(ros.node)
    diagnostics.count('dropped')
    diagnostics.count('dropped')
    status = diagnostics.status()
    assert status.level == WARN and values_of(status)['dropped'] == '2'
    assert status.message.startswith('2 dropped in 10 s: more comes than there is time for')


def test_a_failure_goes_before_a_refusal_and_before_the_judge(ros):
    diagnostics = Diagnostics(ros.node, judge=lambda: (WARN, 'no calibration'))
    diagnostics.refuse('no calibration', 'no rig is set')
    assert diagnostics.status().message == 'no calibration'
    diagnostics.fail('the camera is gone')
    status = diagnostics.status()
    assert (status.level, status.message) == (ERROR, 'the camera is gone')


def test_the_state_comes_every_second(ros):
    diagnostics = Diagnostics(ros.node)
    last = ros.diagnostics('tester')
    diagnostics.count('images')
    assert values_of(ros.until(last))['images'] == '1'
    diagnostics.count('images')
    ros.until(lambda: values_of(last())['images'] == '2')
