"""A check of the rig by one photograph, in a process of its own, behind whatever else runs.

It takes SciPy's optimisers some tenths of a second, much of it in Python: in a thread it would
hold up the photographs that come meanwhile.
"""

from __future__ import annotations

import json
import os
import pickle
import resource
import subprocess
import sys
import threading
from dataclasses import dataclass

from numpy.typing import NDArray

from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.process import VARIABLES
from ftp_dent_ros.rig.rig import Rig

# Seconds of processor time, of which it takes some tenths; on a busy computer they take long.
_LONGEST = 120


@dataclass(frozen=True)
class RigVerdict:
    """What `wall_check` says of a rig.

    Attributes
    ----------
    holds : bool
    sentence : str
    """

    holds: bool
    sentence: str


class CheckAside:
    """Checks of a rig on a skin of any form, one after the other."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._ended = False
        self._lock = threading.Lock()

    def check(
        self, rig: Rig, pattern: Pattern, photograph: Photograph, points: NDArray
    ) -> RigVerdict:
        """Check a rig by a photograph and the cloud of it, as `wall_check.check` does.

        Raises
        ------
        CalibrationError
            Too little was measured, or the process did not come to an end.
        """
        given = pickle.dumps((rig, pattern, photograph, points), pickle.HIGHEST_PROTOCOL)
        with self._lock:
            if self._ended:
                raise CalibrationError('it was ended')
            process = self._process = subprocess.Popen(
                [sys.executable, '-m', __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **dict.fromkeys(VARIABLES, '1')},
            )
        try:
            told, _ = process.communicate(given)
        finally:
            process.kill()
            process.wait()
        if process.returncode:
            raise CalibrationError(f'its process ended with the status {process.returncode}')
        reply = json.loads(told)
        if 'reason' in reply:
            raise CalibrationError(reply['reason'])
        return RigVerdict(**reply)

    def end(self) -> None:
        """End the check under way, and start none any more."""
        with self._lock:
            self._ended = True
            if self._process is not None:
                self._process.kill()


def main() -> None:
    """Check what comes in on the standard input."""
    # The last priority there is: photographs go first.
    os.nice(19)
    resource.setrlimit(resource.RLIMIT_CPU, (_LONGEST, _LONGEST))
    import numpy as np

    from ftp_dent_ros.calibration.wall_check import check

    rig, pattern, photograph, points = pickle.load(sys.stdin.buffer)
    try:
        found = check(rig, pattern, photograph, points, flatness=float('inf'))
        reply = {'holds': found.holds, 'sentence': found.sentence}
    except (CalibrationError, np.linalg.LinAlgError, ValueError) as reason:
        reply = {'reason': str(reason)}
    json.dump(reply, sys.stdout)


if __name__ == '__main__':
    main()
