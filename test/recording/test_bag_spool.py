import threading

import pytest
from bag_samples import START_NS, STRING, WORDS, string_data

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.reader import read_messages
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagSpool, BagWriter


class HeldWriter(BagWriter):
    """A disk that takes its time: nothing is written before `go` is set."""

    def __init__(self, folder):
        super().__init__(folder)
        self.go = threading.Event()
        self.called = threading.Event()

    def write(self, messages):
        self.called.set()
        assert self.go.wait(60)
        super().write(messages)


@pytest.fixture
def writer(tmp_path):
    writer = HeldWriter(tmp_path / 'bag')
    writer.add_topic(WORDS)
    return writer


def message(number: int, size: int = 1000) -> Message:
    return Message('/words', STRING, START_NS + number, START_NS, string_data('x' * size))


def test_messages_wait_in_order_while_the_disk_is_busy(tmp_path, writer):
    spool = BagSpool(writer, 1_000_000)
    assert all(spool.put(message(number)) for number in range(100))
    assert writer.message_count == 0
    writer.go.set()
    spool.close()
    writer.close()
    assert list(read_messages(tmp_path / 'bag')) == [message(number) for number in range(100)]
    assert spool.dropped == 0


def test_what_does_not_fit_is_dropped_and_counted(tmp_path, writer):
    spool = BagSpool(writer, 10 * len(message(0).data))
    taken = [spool.put(message(number)) for number in range(15)]
    assert taken == [True] * 10 + [False] * 5
    writer.go.set()
    spool.close()
    writer.close()
    assert spool.dropped == 5
    assert len(list(read_messages(tmp_path / 'bag'))) == 10


def test_a_message_larger_than_the_queue_is_taken_alone(tmp_path, writer):
    spool = BagSpool(writer, 100)
    assert spool.put(message(0, 5000))
    assert not spool.put(message(1, 5000))
    writer.go.set()
    spool.close()
    writer.close()
    assert len(list(read_messages(tmp_path / 'bag'))) == 1


def test_a_failing_disk_stops_the_thread_and_is_told(writer, monkeypatch):
    spool = BagSpool(writer, 1_000_000)
    failure = BagError('the disk is full')

    def fail(file, entries):
        raise failure

    monkeypatch.setattr(BagWriter, '_write', fail)
    spool.put(message(0))
    spool.put(message(1))
    writer.go.set()
    spool.close()
    assert spool.error is failure
    assert spool.dropped == 2
    assert not spool.put(message(2))
    assert spool.dropped == 3
