"""What a node says about itself once a second on /diagnostics."""

from __future__ import annotations

import statistics
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from ftp_dent_ros.errors import CameraError, InputError, PoseError, RefusedFrameError
from ftp_dent_ros.ros.qos import DIAGNOSTICS

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
#: Whether something holds at the moment, its level, and what to say then.
Verdict = tuple[object, bytes, str]

# Seconds that rates are of, and between two lines in the log on one matter.
_WINDOW = 10.0


class Diagnostics:
    """Publishes a node's state on ``/diagnostics`` at 1 Hz, on the steady clock.

    Counts, rates and durations are of the last ten seconds, totals of all; any thread may count.

    Parameters
    ----------
    node : rclpy.node.Node
    judge : callable, optional
        Gives what the node itself knows: the first `Verdict` that holds counts; a refusal or a
        failure of the last ten seconds that is worse goes first.

    Attributes
    ----------
    hardware_id : str
        The device that the node speaks for.
    """

    def __init__(self, node: Node, judge: Callable[[], Sequence[Verdict]] = tuple) -> None:
        self._node = node
        self._judge = judge
        self.hardware_id = ''
        self._start, self._lock = time.monotonic(), threading.Lock()
        # When, and how long what lasts took; how many of what is counted there ever were.
        self._events: dict[str, deque[tuple[float, float]]] = {}
        self._totals: Counter[str] = Counter()
        self._notes: dict[str, str] = {}
        self._last = {'refused': '', 'failed': ''}
        self._logged: dict[str, float] = {}
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', DIAGNOSTICS)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(1.0, self._publish, clock=clock)

    def count(self, name: str, seconds: float | None = None) -> None:
        """Count one `name` ('images', say), or a duration ('latency', say).

        Of the ones total and rate are shown, of the others median and maximum.
        """
        with self._lock:
            self._totals[name] += seconds is None
            new = time.monotonic(), seconds or 0.0
            self._events.setdefault(name, deque(maxlen=10_000)).append(new)

    @contextmanager
    def timed(self, done: str, stamp_ns: int) -> Iterator[None]:
        """Count what the block has `done`, how long it took, and how long ago its exposure was.

        Nothing is counted of what raises.
        """
        started = time.monotonic()
        yield
        self.count(done)
        self.count('computation', time.monotonic() - started)
        latency = (self._node.get_clock().now().nanoseconds - stamp_ns) / 1e9
        # After a longer time what came is of a recording.
        if 0 <= latency < 60.0:
            self.count('latency', latency)

    def note(self, values: Mapping[str, object]) -> None:
        """Show some values from now on, by name."""
        self._notes.update((name, str(value)) for name, value in values.items())

    def refuse(self, reason: str, sentence: str) -> None:
        """Something that was given gave no result, for a reason of a few fixed words."""
        self.count('refused')
        self.count(f'refused: {reason}')
        self._last['refused'] = f'{reason}: {sentence}'
        if self._is_due(reason):
            self._node.get_logger().warning(f'refused, {reason}: {sentence}')

    def fail(self, sentence: str) -> None:
        """Something does not work; the level is ERROR for ten seconds."""
        self.count('failed')
        self._last['failed'] = sentence
        if self._is_due(sentence):
            self._node.get_logger().error(sentence)

    @contextmanager
    def guarded(self, what: str, reason: str = '') -> Iterator[None]:
        """Tell of what the block raises, and go on behind it: no message may end a node.

        Parameters
        ----------
        what : str
            Could not be done, in a sentence on a defect of the software.
        reason : str
            Of a refusal of what was given; the error's own by default.
        """
        try:
            yield
        except (InputError, PoseError, RefusedFrameError) as error:
            self.refuse(reason or error.reason, str(error))
        except CameraError as error:
            self.fail(str(error))
        except Exception as error:
            self.fail(
                f'{what}, by a defect of the software ({type(error).__name__}: {error}): report '
                'it with the log'
            )
            self._node.get_logger().debug(traceback.format_exc())

    def recent(self, name: str) -> int:
        """How many `name` there were in the last ten seconds."""
        return len(self._recent(name))

    def _recent(self, name: str) -> list[float]:
        """Durations of the events of the last ten seconds; 0 of those that have none."""
        since = time.monotonic() - _WINDOW
        with self._lock:
            return [seconds for at, seconds in self._events.get(name, ()) if at >= since]

    def _counted(self) -> dict[str, str]:
        """Total and rate of what is counted, median and maximum of what lasts."""
        lived = min(max(time.monotonic() - self._start, 1.0), _WINDOW)
        values = dict.fromkeys(self._last, '0')
        for name in list(self._events):
            recent, total = self._recent(name), self._totals[name]
            if total:
                values[name] = str(total)
                # Of troubles the totals tell enough.
                if name.partition(':')[0] not in self._last:
                    values[f'{name} per second'] = f'{len(recent) / lived:.2f}'
            elif recent:
                values[f'{name} median (ms)'] = f'{1e3 * statistics.median(recent):.1f}'
                values[f'{name} maximum (ms)'] = f'{1e3 * max(recent):.1f}'
        return values

    def status(self) -> DiagnosticStatus:
        """State of the moment."""
        refusals, drops = self.recent('refused'), self.recent('dropped')
        verdicts: list[Verdict] = [
            (self.recent('failed'), ERROR, self._last['failed']),
            *self._judge(),
            (True, OK, 'working'),
        ]
        level, message = next((level, said) for holds, level, said in verdicts if holds)
        troubles = [
            (refusals, f'{refusals} refused in 10 s, last {self._last["refused"]}'),
            (drops, f'{drops} dropped in 10 s: more comes than there is time for, lower its rate'),
        ]
        if level == OK and (refusals or drops):
            level, message = WARN, '; '.join(said for count, said in troubles if count)
        values = {**self._notes, **self._counted()}
        return DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name().lstrip('/'),
            message=message,
            hardware_id=self.hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    def _publish(self) -> None:
        array = DiagnosticArray(status=[self.status()])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _is_due(self, what: str) -> bool:
        """Whether `what` was last logged more than a window ago."""
        now = time.monotonic()
        if now - self._logged.get(what, -_WINDOW) < _WINDOW:
            return False
        if len(self._logged) > 100:
            self._logged.clear()
        self._logged[what] = now
        return True
