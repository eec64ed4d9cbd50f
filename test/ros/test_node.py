"""What every node is made of: its diagnostics, the thread of its work, and its end."""

from __future__ import annotations

import gc
import threading

import pytest
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup

from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics
from ftp_dent_ros.ros.node import NewestWorker, ThreadedExecutor


def values_of(status):
    return {item.key: item.value for item in status.values}


def test_counts_durations_and_notes_are_shown(ros, monkeypatch):
    monkeypatch.setattr('time.monotonic', lambda: 100.0)
    diagnostics = Diagnostics(ros.node)
    diagnostics.hardware_id = '/dev/video0'
    for seconds in (0.010, 0.030, 0.020):
        diagnostics.count('images')
        diagnostics.count('latency', seconds)
    diagnostics.note({'period (px)': 8})
    status = diagnostics.status()
    values = values_of(status)
    assert (status.level, status.message, status.hardware_id) == (OK, 'working', '/dev/video0')
    assert status.name == f'{ros.namespace}/tester'.lstrip('/')
    assert (values['images'], values['images per second']) == ('3', '3.00')
    assert values['latency median (ms)'] == '20.0'
    assert values['latency maximum (ms)'] == '30.0'
    assert (values['period (px)'], values['refused'], values['failed']) == ('8', '0', '0')
    diagnostics.count('dropped')
    status = diagnostics.status()
    assert status.level == WARN and values_of(status)['dropped'] == '1'
    assert status.message.startswith('1 dropped in 10 s: more comes than there is time for')


def test_a_failure_goes_before_a_refusal_and_before_the_judge(ros):
    diagnostics = Diagnostics(ros.node, judge=lambda: [(True, WARN, 'no calibration')])
    diagnostics.refuse('no calibration', 'no rig is set')
    assert diagnostics.status().message == 'no calibration'
    diagnostics.fail('the camera is gone')
    status = diagnostics.status()
    assert (status.level, status.message) == (ERROR, 'the camera is gone')


@pytest.mark.parametrize(
    ('room', 'dropped', 'left'), [(1, 2, ['fourth']), (2, 1, ['third', 'fourth'])]
)
def test_only_the_newest_wait(ros, room, dropped, left):
    entered, leave = threading.Event(), threading.Event()
    done = []

    def work(item):
        entered.set()
        assert leave.wait(60)
        done.append(item)

    diagnostics = Diagnostics(ros.node)
    worker = NewestWorker(diagnostics, work, 'nothing was done', room)
    assert worker.settle(0.0)
    worker.put('first')
    assert entered.wait(60)
    for item in ('second', 'third', 'fourth'):
        worker.put(item)
    assert diagnostics.recent('dropped') == dropped and len(worker) == 1 + room
    assert not worker.settle(0.0)
    leave.set()
    assert worker.settle(60)
    worker.stop()
    assert done == ['first', *left]


def test_what_cannot_be_done_ends_nothing(ros):
    diagnostics = Diagnostics(ros.node)
    worker = NewestWorker(diagnostics, lambda item: 1 / item, 'a number could not be inverted')
    for number in (0, 1):
        worker.put(number)
    worker.stop(finish=True)
    assert diagnostics.status().message.startswith('a number could not be inverted, by a defect')


def end_at_work(domain):
    """What a shutdown gives, and what callbacks had ended by then."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node('ending', context=context)
    executor = ThreadedExecutor(4, context=context)
    begun, may_end, ended = threading.Event(), threading.Event(), []

    def wait():
        begun.set()
        ended.append(may_end.wait(30))

    for _ in range(4):
        node.create_timer(0.001, wait, callback_group=ReentrantCallbackGroup())
    executor.add_node(node)
    while not begun.is_set():
        executor.spin_once(timeout_sec=0.1)
    told: list = []

    def end():
        told.append(executor.shutdown(30))
        told.extend(ended)

    ending = threading.Thread(target=end)
    ending.start()
    assert told == []
    may_end.set()
    ending.join()
    node.destroy_node()
    context.try_shutdown()
    return told


def test_callbacks_under_way_end_before_what_they_use_is_destroyed(domain, capfd):
    shut, *ended = end_at_work(domain)
    assert shut and ended and all(ended)
    gc.collect()
    assert 'never retrieved' not in capfd.readouterr().err
