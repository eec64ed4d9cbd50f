import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ftp_dent_ros.supervision.processes import (
    Processes,
    Program,
    respawn_delay,
    stop_event_meanwhile,
)

# `-I -S`: a bare interpreter that starts at once.
BARE = (sys.executable, '-I', '-S', '-c')
WAIT = 'import os, signal\nprint(os.getpid(), flush=True)\nwhile True: signal.pause()'


def script(name, text):
    return Program(name, (*BARE, text))


def until(condition, timeout=60.0):
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, 'waited in vain'
        time.sleep(0.01)


def is_alive(pid):
    try:
        state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except FileNotFoundError:
        return False
    return state != 'Z'


@pytest.fixture
def running():
    """Processes, and the lines that they print."""
    lines = []
    with Processes(lambda *line: lines.append(line)) as processes:
        yield processes, lines


def test_stops_with_one_term(running):
    processes, lines = running
    goodbye = (
        'import os, signal\n'
        # A signal may come in the middle of a print, and a second one is not let in then.
        'def end(*_):\n os.write(1, b"goodbye\\n")\n raise SystemExit\n'
        'signal.signal(signal.SIGTERM, end)\n'
    )
    for name in 'ab':
        processes.start(script(name, goodbye + WAIT))
    until(lambda: len(lines) == 2)
    assert processes.stop() == {'a': 0, 'b': 0} and processes.names == ()
    assert lines.count(('a', 'goodbye')) == lines.count(('b', 'goodbye')) == 1


def test_takes_grandchildren_along(running):
    processes, lines = running
    family = (
        'import subprocess\nchild = subprocess.Popen(["sleep", "1000"])\n'
        'print(child.pid, flush=True)\n'
    )
    processes.start(script('a', family + WAIT))
    until(lambda: lines)
    grandchild = int(lines[0][1])
    assert is_alive(grandchild)
    processes.stop()
    until(lambda: not is_alive(grandchild))


@pytest.mark.skipif(not shutil.which('setpriv'), reason='setpriv is not installed')
def test_leaves_no_orphan_when_it_is_killed():
    starter = f"""
import time
from ftp_dent_ros.supervision.processes import Processes, Program
processes = Processes(lambda name, line: print(line, flush=True))
for name in 'ab':
    processes.start(Program(name, {(*BARE, WAIT)!r}))
time.sleep(1000)
"""
    with subprocess.Popen(
        [sys.executable, '-c', starter], stdout=subprocess.PIPE, text=True
    ) as parent:
        children = [int(parent.stdout.readline()) for _ in 'ab']
        assert all(map(is_alive, children))
        parent.kill()
        until(lambda: not any(map(is_alive, children)))


def test_what_ends_soon_waits_longer_each_time_and_what_ran_well_does_not_wait():
    delays = [0.0]
    for _ in range(7):
        delays.append(respawn_delay(1, 5.0, delays[-1]))
    assert delays[1:] == [1, 2, 4, 8, 16, 30, 30]
    assert respawn_delay(-9, 61.0, 30.0) == 0
    assert respawn_delay(2, 61.0, 30.0) is None


def test_a_signal_is_heard_also_where_its_events_lock_is_held():
    with stop_event_meanwhile() as stop:
        with stop._cond:  # as `wait` holds it for a moment
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
        assert stop.wait(60)
