"""How the process uses the machine: its memory between photographs, its threads."""

from __future__ import annotations

import ctypes
import os
import struct
import time

# Parameters of glibc's mallopt (malloc.h).
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
# Free bytes at the heap's end that are kept: what one photograph of 1920x1080 needs on its way,
# about. Blocks up to the second size come from the heap: glibc's own most.
_KEPT, _LARGEST_BLOCK = 128 << 20, 32 << 20

#: Variables that the builds of BLAS read as they are loaded.
VARIABLES = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


def keep_freed() -> None:
    """Have the C library keep memory that is freed for what comes next.

    Else each message and each cloud is given back to the system and fetched anew, a fault a page:
    2500 of them for a cloud of 640x360, 9 of the 59 ms of processor time that it takes a node.
    C libraries without such parameters are left as they are.
    """
    mallopt = getattr(ctypes.CDLL(None), 'mallopt', None)
    if mallopt is None:
        return
    # Arenas of threads give back whatever becomes free, so that there is one for all.
    for parameter, value in (
        (_ARENA_MAX, 1),
        (_MMAP_THRESHOLD, _LARGEST_BLOCK),
        (_TRIM_THRESHOLD, _KEPT),
    ):
        mallopt(parameter, value)


def end_within(seconds: int, status: int) -> None:
    """Have the process end with a status if by then it has not ended by itself.

    Even if a call that never returns holds the interpreter, so that no thread or signal handler of
    Python's runs: the C library does it.
    """
    libc, timer = ctypes.CDLL(None), ctypes.c_void_p()
    end = ctypes.cast(libc._exit, ctypes.c_void_p).value
    # Linux's struct sigevent: SIGEV_THREAD (2) calls a function with the first value.
    event = struct.pack('qiiPP32x', status, 0, 2, end, 0)
    libc.timer_create(time.CLOCK_MONOTONIC, event, ctypes.byref(timer))
    libc.timer_settime(timer, 0, struct.pack('4q', 0, 0, seconds, 0), None)


def one_for_blas() -> None:
    """Have BLAS compute with one thread, unless the environment says otherwise.

    In this process, if it has not loaded it yet, and in those that it starts. The matrices here
    are small: threads spin as they wait for one another, and where other processes have work to
    do, a calibration takes five times the processor time with two, and ten times as long; a
    cloud of 1920x1080 up to ten times.
    """
    for name in VARIABLES:
        os.environ.setdefault(name, '1')
