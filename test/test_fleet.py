"""Items worked on in processes: results, failures, and a process that is killed."""

import os
import signal

import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.fleet import (
    LostWorkerError,
    in_order,
    side_by_side,
)


def square(number):
    if number == 13:
        raise ValueError('unlucky')
    if number < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2, os.environ['OPENBLAS_NUM_THREADS']


def test_one_that_raises_and_one_whose_process_dies_are_told_and_the_rest_is_done():
    results = dict(side_by_side(square, [1, 13, -1, 2, 3], jobs=2))
    assert isinstance(results.pop(13), ValueError)
    assert isinstance(results.pop(-1), LostWorkerError)
    assert results == {number: (number**2, '1') for number in (1, 2, 3)}


def twice(number):
    return 2 * number


@pytest.mark.parametrize('jobs', [1, 2])
def test_results_come_in_order_of_processes_that_work_a_little_ahead(jobs):
    read = []

    def items():
        for number in range(40):
            read.append(number)
            yield number

    results = in_order(twice, items(), jobs)
    assert next(results) == 0
    assert len(read) < 20
    assert list(results) == list(range(2, 80, 2))


def killed_beside(task):
    number, first = task
    if os.getpid() != first:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_what_a_killed_process_left_is_done_by_this_one():
    tasks = [(number, os.getpid()) for number in range(12)]
    assert list(in_order(killed_beside, tasks, jobs=2)) == list(range(12))


def ends_at_once(_):
    """Whether Ctrl-C ends this process, without a word of Python's."""
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    return signal.getsignal(signal.SIGINT) is signal.SIG_DFL and signal.SIGINT not in blocked


def test_an_interruption_ends_the_processes_without_a_word_and_reaches_this_one():
    before = signal.getsignal(signal.SIGINT), signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert list(side_by_side(ends_at_once, [1], 1)) == [(1, True)]
    after = signal.getsignal(signal.SIGINT), signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert before == after and signal.SIGINT not in after[1]


def test_on_a_cluster_results_are_the_same_and_a_failure_is_told(monkeypatch):
    distributed = pytest.importorskip('distributed', reason='needs Dask')
    from ftp_dent_ros import fleet as ours

    on_cluster = ours.on_cluster

    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host='127.0.0.1', dashboard_address=None
    )
    with cluster:
        results = dict(on_cluster(square, [1, 13, 2, 3], cluster.scheduler_address))
        address = cluster.scheduler_address
    assert isinstance(results.pop(13), ValueError)
    assert results == {number: (number**2, '1') for number in (1, 2, 3)}
    monkeypatch.setattr(ours, '_PATIENCE', 0.3)
    with pytest.raises(ConfigurationError, match='no Dask scheduler answers'):
        list(on_cluster(square, [1], address.rpartition(':')[0] + ':1'))
