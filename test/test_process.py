"""BLAS with one thread a process, unless the user wants more; an end that nothing holds up."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from ftp_dent_ros.process import VARIABLES

SCRIPT = """
import os
from ftp_dent_ros.{module}
import numpy
print(len(os.listdir('/proc/self/task')), os.environ['OPENBLAS_NUM_THREADS'])
"""
HELD = """
import ctypes
from ftp_dent_ros.process import end_within
end_within(1, 7)
ctypes.PyDLL(None).pause()
"""
CALLED = SCRIPT.format(module='process import one_for_blas; one_for_blas()')


def threads(script: str, **told: str) -> list[int]:
    """Threads after NumPy was loaded, and those that BLAS was told."""
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    found = subprocess.run(
        [sys.executable, '-c', script],
        env={**environment, **told},
        capture_output=True,
        text=True,
        check=True,
    )
    return [int(word) for word in found.stdout.split()]


@pytest.mark.skipif(not os.path.isdir('/proc/self/task'), reason='threads are counted in /proc')
def test_blas_has_one_thread_unless_the_environment_says_otherwise():
    assert threads(CALLED) == [1, 1]
    assert threads(SCRIPT.format(module='nodes import __doc__')) == [1, 1]
    more, wanted = threads(CALLED, OPENBLAS_NUM_THREADS='2')
    assert wanted == 2
    assert more <= 2


def test_a_call_that_never_returns_and_holds_the_interpreter_does_not_keep_the_process():
    assert subprocess.run([sys.executable, '-c', HELD], timeout=60).returncode == 7
