"""The simulated radio, and the link over it between two network namespaces."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from simulated_radio import Conditions, RadioPath, joined_sites

from ftp_dent_ros.errors import ConfigurationError

END = str(Path(__file__).with_name('end_of_link.py'))


def carried(conditions, packets=20_000, interval=0.001, size=100):
    """(number, delay) of the packets that come out, in their order."""
    way = RadioPath(3)
    way.conditions = conditions
    out, now = [], 0.0
    for number in range(packets):
        now = number * interval
        way.put(number.to_bytes(4, 'big') + bytes(size - 4), now)
        out += [(packet, now) for packet in way.due(now)]
    while way.next_due < float('inf'):
        now = way.next_due
        out += [(packet, now) for packet in way.due(now)]
    numbers = [int.from_bytes(packet[:4], 'big') for packet, _ in out]
    return numbers, np.array(
        [when - n * interval for n, (_, when) in zip(numbers, out, strict=True)]
    )


@pytest.mark.parametrize('share, burst', [(0.01, 1), (0.05, 2), (0.02, 5)])
def test_losses_are_as_many_and_as_long_as_asked(share, burst):
    numbers, _ = carried(Conditions(loss=share, burst=burst))
    lost = sorted(set(range(20_000)) - set(numbers))
    assert len(lost) / 20_000 == pytest.approx(share, rel=0.35)
    runs = 1 + np.count_nonzero(np.diff(lost) > 1)
    assert len(lost) / runs == pytest.approx(burst, rel=0.3)


def test_the_rate_is_kept_and_a_full_buffer_loses():
    # 800 kbit/s into 400 kbit/s.
    numbers, delays = carried(Conditions(rate=400e3, buffer=0.2))
    assert len(numbers) == pytest.approx(10_000, rel=0.02)
    assert delays.max() <= 0.203


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
