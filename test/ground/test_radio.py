"""The link over a simulated radio between two network namespaces."""

import subprocess
import sys
from pathlib import Path

import pytest
from simulated_radio import Conditions, joined_sites

from ftp_dent_ros.errors import ConfigurationError

END = str(Path(__file__).with_name('end_of_link.py'))


@pytest.fixture
def sites():
    try:
        with joined_sites(Conditions(2e6, 0.05, 0.005, 0.02, burst=3)) as joined:
            yield joined
    except ConfigurationError as reason:
        pytest.skip(f'{reason}: the link over a radio is not tested')


def test_all_arrives_over_a_bad_radio_once_and_in_order_of_importance(sites):
    pytest.importorskip('zenoh', reason='Zenoh is not installed: the link is not tested')
    address, count = f'{sites.drone.address}:7447', 8

    def start(site, role, **pipes):
        words = [sys.executable, END, role, address, str(count)]
        return subprocess.Popen(site.command(words), text=True, **pipes)

    drone = start(sites.drone, 'drone', stdin=subprocess.PIPE)
    ground = start(sites.ground, 'ground', stdout=subprocess.PIPE)
    try:
        lines = []
        for line in ground.stdout:
            lines.append(tuple(line.split()))
            if len(lines) == count:
                # Worse, in the midst of it.
                sites.set(Conditions(1e6, 0.08, 0.01, 0.03, 3, duplicate=0.02, reorder=0.02))
        assert ground.wait(60) == 0
        drone.stdin.close()
        assert drone.wait(60) == 0
    finally:
        for process in (drone, ground):
            process.kill()
            process.wait()
    assert len(lines) == len(set(lines)) == 2 * count
    assert [line[0] for line in lines[:count]] == ['DENTS'] * count
    assert {line[1] for line in lines if line[0] == 'CLOUDS'} == set(map(str, range(count)))
    assert sites.ground.traffic()[0] > 160_000
