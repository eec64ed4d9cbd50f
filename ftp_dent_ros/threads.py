"""How many threads the numeric libraries compute with."""

from __future__ import annotations

import os

#: Variables that the builds of BLAS read as they are loaded.
VARIABLES = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


def one_for_blas() -> None:
    """Have BLAS compute with one thread, unless the environment says otherwise.

    In this process, if it has not loaded it yet, and in those that it starts. The matrices here
    are small: threads spin as they wait for one another, and where other processes have work to
    do, a calibration takes five times the processor time with two, and ten times as long; a
    cloud of 1920x1080 up to ten times.
    """
    for name in VARIABLES:
        os.environ.setdefault(name, '1')
