"""Real rclpy between real processes, on a domain of this test run's own."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.rig.rig import Lens, Rig, write_rig

HAS_ROS = importlib.util.find_spec('rclpy') is not None


class _Skipped(pytest.Module):
    def collect(self):
        pytest.skip('rclpy is not installed: nothing that needs ROS is tested')


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector):
    return None if HAS_ROS else _Skipped.from_parent(parent, path=module_path)


@pytest.fixture(scope='session')
def domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """A ROS domain that no other test run on this machine uses, for this process and its own."""
    os.environ['ROS_LOG_DIR'] = str(tmp_path_factory.mktemp('ros_log'))
    from ftp_dent_ros.supervision.transport import free_domain

    with free_domain() as domain_id:
        yield domain_id


def _plain(text: str) -> str:
    """A text without the terminal's colours."""
    return re.sub(r'\x1b\[[0-9;]*m', '', text)


class Process:
    """A node as a process of its own."""

    def __init__(self, module: str, arguments: list[str], log: Path) -> None:
        self.log = log
        with log.open('w') as output:
            self._popen = subprocess.Popen(
                [sys.executable, '-m', module, *arguments],
                stdout=output,
                stderr=subprocess.STDOUT,
            )

    @property
    def output(self) -> str:
        return self.log.read_text(errors='replace')

    @property
    def said(self) -> list[str]:
        """Its own lines: Fast DDS has a word of its own on ports that killed processes left."""
        return [line for line in self.output.splitlines() if '[RTPS_' not in _plain(line)]

    def told(self, sentence: str) -> bool:
        """Whether it has ended with status 2 and this sentence in its only line."""
        return self.wait() == 2 and len(self.said) == 1 and sentence in self.output

    @property
    def alive(self) -> bool:
        return self._popen.poll() is None

    @property
    def pid(self) -> int:
        return self._popen.pid

    def wait(self, timeout: float = 120.0) -> int:
        """Exit status."""
        return self._popen.wait(timeout)

    def send(self, with_signal: int) -> None:
        self._popen.send_signal(with_signal)

    def stop(self, with_signal: int = signal.SIGINT, timeout: float = 60.0) -> int:
        """Exit status after a signal."""
        if self.alive:
            self._popen.send_signal(with_signal)
        return self._popen.wait(timeout)

    def kill(self) -> None:
        if self.alive:
            self._popen.kill()
        self._popen.wait()


class Ros:
    """A node of the test's own, in a context and a namespace that no other test has.

    Attributes
    ----------
    node : rclpy.node.Node
    namespace : str
        Of the node, and of the processes that are started.
    """

    _numbers = count()

    def __init__(self, domain_id: int, folder: Path) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.namespace = f'/test{next(self._numbers)}'
        self._folder = folder
        self._processes: list[Process] = []
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.node = rclpy.create_node('tester', namespace=self.namespace, context=self.context)
        self.executor.add_node(self.node)

    def until(self, condition: Callable[[], Any], timeout: float = 120.0) -> Any:
        """Spin until `condition` gives something true, which is returned."""
        end = time.monotonic() + timeout
        while True:
            result = condition()
            if result:
                return result
            if time.monotonic() > end:
                outputs = [f'--- {item.log.name}\n{item.output}' for item in self._processes]
                pytest.fail(f'not reached within {timeout:g} s\n' + '\n'.join(outputs))
            self.executor.spin_once(timeout_sec=0.02)

    def start(self, name: str, *arguments: str, **parameters: Any) -> Process:
        """Start a node of the package; parameters as keywords, `__` in a name stands for a dot."""
        words = ['--ros-args', '-r', f'__ns:={self.namespace}']
        for key, value in parameters.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            text = "''" if text == '' else text
            words += ['-p', f'{key.replace("__", ".")}:={text}']
        return self._run(name, 'ftp_dent_ros.nodes', name, *words, *arguments)

    def command(self, *words: Any) -> Process:
        """Start a command of the package."""
        return self._run(str(words[0]), 'ftp_dent_ros.cli.main', *map(str, words))

    def _run(self, name: str, module: str, *arguments: str) -> Process:
        log = self._folder / f'{name}{len(self._processes)}.log'
        self._processes.append(Process(module, [*arguments], log))
        return self._processes[-1]

    def collect(self, message_type: Any, topic: str, qos: Any = 100) -> list[Any]:
        """List to which the messages of a topic are appended as they come."""
        messages: list[Any] = []
        self.node.create_subscription(message_type, topic, messages.append, qos)
        return messages

    def publisher(self, message_type: Any, topic: str, qos: Any = 10) -> Any:
        """Publisher that somebody is subscribed to already."""
        publisher = self.node.create_publisher(message_type, topic, qos)
        self.until(publisher.get_subscription_count)
        return publisher

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Response of a service."""
        client = self.node.create_client(service_type, name)
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def met_by(self, name: str) -> None:
        """Wait until a node of this namespace knows all that this one publishes and hears.

        It learns of them in the order in which they were made, and the client is the newest.
        """
        from rcl_interfaces.srv import ListParameters

        self.call(ListParameters, f'{name}/list_parameters', ListParameters.Request())

    def diagnostics(self, name: str) -> State:
        """What a node of this namespace says of itself."""
        return State(self, f'{self.namespace}/{name}'.lstrip('/'))

    def close(self) -> None:
        for process in self._processes:
            process.kill()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


class State:
    """The last diagnostic status of a node; None, '' or nothing before the first."""

    def __init__(self, ros: Ros, name: str) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        self._ros, self._name = ros, name
        self._arrays = ros.collect(DiagnosticArray, '/diagnostics')

    def __call__(self) -> Any:
        found = [
            status
            for array in self._arrays
            for status in array.status
            if status.name == self._name
        ]
        return found[-1] if found else None

    @property
    def message(self) -> str:
        return self().message if self() else ''

    def value(self, key: str) -> str | None:
        values = self().values if self() else ()
        return next((item.value for item in values if item.key == key), None)

    def says(self, words: str) -> None:
        """Wait until the message begins so."""
        self._ros.until(lambda: self.message.startswith(words))

    def shows(self, key: str, value: Any) -> None:
        """Wait until a value is that."""
        self._ros.until(lambda: self.value(key) == str(value))


@pytest.fixture(scope='session')
def rig() -> Rig:
    """A small rig: camera of 400x260 and projector of 320x200 pixels, 0.2 m apart."""
    camera = Lens(400, 260, np.array([[520.0, 0, 199.5], [0, 520, 129.5], [0, 0, 1]]), np.zeros(5))
    projector = Lens(
        320, 200, np.array([[430.0, 0, 159.5], [0, 430, 99.5], [0, 0, 1]]), np.zeros(5)
    )
    turn = Rotation.from_euler('y', 0.3).as_matrix()
    return Rig(camera, projector, turn, np.array([-0.2, 0.0, 0.03]))


@pytest.fixture
def rig_file(rig: Rig, tmp_path: Path) -> Path:
    path = tmp_path / 'rig.yaml'
    write_rig(path, rig)
    return path


@pytest.fixture
def ros(domain: int, tmp_path: Path) -> Iterator[Ros]:
    """The test's node, with `until`, `start`, `collect`, `publisher`, `call`, `diagnostics`."""
    instance = Ros(domain, tmp_path)
    yield instance
    instance.close()
