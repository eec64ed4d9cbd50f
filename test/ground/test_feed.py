"""A drone's feed and a ground's assembly over a line of the test's own, on the test's clock."""

import os
import random
from pathlib import Path

import pytest

from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground.drone import Feed, Store
from ftp_dent_ros.ground.protocol import (
    SILENCE,
    Importance,
    Item,
    Piece,
    Report,
    deflate,
    inflate,
)
from ftp_dent_ros.ground.station import Assembly

GROUND = bytes(range(16))


class Line:
    """Feed and assembly, joined by a line of a rate, a delay and losses; time is simulated."""

    def __init__(
        self, folder=None, rate=30_000.0, delay=0.05, loss=0.0, limit=0.0, size=10**9, jitter=0.0
    ):
        self.time = 1000.0
        self.rate, self.delay, self.loss, self.up = rate, delay, loss, True
        self.jitter = jitter
        self.store = Store(folder, size)
        self.feed = Feed(GROUND, 1, self.store, limit, self.now)
        self.ground = Assembly(GROUND, 1)
        self.items, self.arrivals, self.pieces = [], [], []
        self._chance = random.Random(4)
        self._down, self._reports = [], []
        self._free = self.time
        self._next_report = self.time

    def now(self):
        return self.time

    def start_ground_anew(self):
        self.ground = Assembly(GROUND, 2)
        self.feed = Feed(GROUND, 2, self.store, now=self.now)
        for kept in self.store:
            self.feed.offer(kept)

    def put(self, importance, stamp, size=1000, topic='t', latest=False):
        data = random.Random(stamp).randbytes(size)
        kept = self.store.put(Item(importance, topic, 'k', stamp, data, latest))
        self.feed.offer(kept)
        return kept

    def run(self, seconds, step=0.005):
        end = self.time + seconds
        while self.time < end:
            self._send()
            self._receive()
            self.time += step
        return self.items

    def _send(self):
        while (piece := self.feed.next_piece()) is not None:
            self.pieces.append((self.time, piece))
            self._free = max(self._free, self.time) + (len(piece.data) + 40) / self.rate
            if self.up and self._chance.random() >= self.loss:
                self._down.append((self._free + self._way(), piece.pack()))
                self._down.sort()

    def _way(self):
        return self.delay + self.jitter * self._chance.random()

    def _receive(self):
        while self._down and self._down[0][0] <= self.time:
            _, data = self._down.pop(0)
            if self.up:
                item = self.ground.add(Piece.unpack(data))
                if item is not None:
                    self.items.append(item)
                    self.arrivals.append(self.time)
                self._reports.append((self.time + self._way(), self.ground.report().pack()))
                self._reports.sort()
        if self.time >= self._next_report:
            self._next_report = self.time + 0.5
            self._reports.append((self.time + self._way(), self.ground.report().pack()))
            self._reports.sort()
        while self._reports and self._reports[0][0] <= self.time:
            _, data = self._reports.pop(0)
            if self.up:
                for kept in self.feed.take(Report.unpack(data)):
                    self.store.remove(kept)


def stamps(items, importance):
    return [item.stamp_ns for item in items if item.importance == importance]


def test_the_order_is_that_of_importance_and_the_newest_go_first():
    line = Line(rate=10_000.0)
    for stamp, importance in enumerate(
        [Importance.PICTURES, *[Importance.CLOUDS] * 3, *[Importance.POSES] * 3, Importance.DENTS]
    ):
        line.put(importance, stamp, 3000, topic=str(stamp))
    got = [item.stamp_ns for item in line.run(10)]
    assert got == [7, 6, 5, 4, 3, 2, 1, 0]


def test_of_more_poses_than_the_link_carries_the_newest_are_there_at_once_and_all_in_the_end():
    line = Line(rate=1000.0, delay=0.2)
    put_at = {}
    for stamp in range(40):
        put_at[stamp] = line.time
        line.put(Importance.POSES, stamp, 400)
        line.run(0.25)  # half of them, at this rate
    by_then = len(line.items)
    late = [at - put_at[item.stamp_ns] for item, at in zip(line.items, line.arrivals, strict=True)]
    assert by_then < 30 and sorted(late)[by_then // 2] < 2.5  # 0.6 s to send, 0.2 s the way
    assert max(stamps(line.items, Importance.POSES)) > 30
    assert sorted(stamps(line.run(30), Importance.POSES)) == list(range(40))


def test_previews_of_several_topics_take_turns():
    line = Line(rate=10_000.0)
    for tick in range(40):
        # What is stamped with its sending is always newer than a photograph.
        line.put(Importance.PREVIEWS, 10**6 + tick, 4000, topic='markers')
        line.put(Importance.PREVIEWS, tick, 4000, topic='cloud')
        line.run(0.25)
    counts = [sum(item.topic == topic for item in line.items) for topic in ('markers', 'cloud')]
    assert sum(counts) > 18 and abs(counts[0] - counts[1]) <= 2


def test_a_topic_takes_its_share_of_the_link_and_the_newest_comes_in_the_end():
    line = Line(rate=30_000.0)
    for stamp in range(60):
        line.put(Importance.PREVIEWS, stamp, 10_000, topic='survey/path', latest=True)
        line.put(Importance.CLOUDS, stamp, 20_000)
        line.run(1.0)
    paths = stamps(line.items, Importance.PREVIEWS)
    # A tenth of the link: one in three seconds.
    assert 12 <= len(paths) <= 25 and len(stamps(line.items, Importance.CLOUDS)) > 50
    assert stamps(line.run(10), Importance.PREVIEWS)[-1] == 59


def test_what_is_more_important_overtakes_within_a_quarter_of_a_second():
    line = Line(rate=30_000.0)
    line.put(Importance.CLOUDS, 1, 2_000_000)
    line.run(20)
    line.put(Importance.DENTS, 2, 500)
    start = line.time
    line.run(2)
    assert stamps(line.items, Importance.DENTS) == [2]
    assert line.arrivals[0] - start < 0.05 + 0.25


@pytest.mark.parametrize('rate', [7_200.0, 32_000.0, 250_000.0, 1_250_000.0])
def test_it_finds_the_rate_of_the_link_and_does_not_flood_it(rate):
    line = Line(rate=rate, delay=0.05)
    line.put(Importance.CLOUDS, 1, 30_000_000)
    line.run(12)
    half = line.ground.bytes
    line.run(8)
    assert (line.ground.bytes - half) / 8 > 0.85 * rate
    # What waits in the link's buffer delays all that comes after it.
    waiting = line._free - line.time
    assert waiting < 0.25


@pytest.mark.parametrize('jitter', [0.05, 0.2])
def test_a_link_that_jitters_is_no_slow_link(jitter):
    line = Line(rate=250_000.0, delay=0.03, jitter=jitter)
    line.put(Importance.CLOUDS, 1, 30_000_000)
    line.run(20)
    half = line.ground.bytes
    line.run(20)
    assert (line.ground.bytes - half) / 20 > 0.8 * line.rate
    assert line.feed.lost < 0.02 * line.feed.sent_pieces
    assert line._free - line.time < 0.3


def test_the_last_piece_before_a_pause_is_not_waited_for_long():
    line = Line(delay=0.1)
    line.put(Importance.DENTS, 1)
    line.run(1)
    line.up = False
    line.put(Importance.DENTS, 2)
    line.run(0.1)
    line.up = True
    start = line.time
    line.run(2)
    assert stamps(line.items, Importance.DENTS) == [1, 2]
    assert line.arrivals[-1] - start < 1.5


def test_what_is_like_the_one_before_it_crosses_as_the_difference():
    line = Line(loss=0.1)
    whole = random.Random(1).randbytes(2000)
    for stamp in range(30):
        item = Item(Importance.DENTS, 'list', 'k', stamp, whole + bytes([stamp]), latest=True)
        line.feed.offer(line.store.put(item))
        line.run(1.0)
    assert [item.data[-1] for item in line.items] == list(range(30))
    assert all(item.data[:-1] == whole for item in line.items)
    assert line.ground.bytes < 3 * len(whole)
    # A ground that starts anew has nothing to tell it from.
    line.start_ground_anew()
    line.feed.offer(line.store.put(Item(Importance.DENTS, 'list', 'k', 99, whole)))
    assert line.run(2.0)[-1].stamp_ns == 99


def test_differences_that_are_none_are_refused():
    whole = random.Random(2).randbytes(300) * 4
    short = deflate(whole + b'x', 7, whole)
    assert len(short) < 50 and inflate(short, {7: whole}.get) == whole + b'x'
    assert inflate(deflate(whole)) == whole == inflate(deflate(whole, level=0))
    bomb = deflate(bytes(40 << 20))
    for wrong in (b'', short[:3], short[:-2], short[:8] + b'\xff' * 9, bomb):
        with pytest.raises(CodecError):
            inflate(wrong, {7: whole}.get)
    with pytest.raises(CodecError, match='never came'):
        Assembly(GROUND, 1).add(Piece(8, 1, 1, len(short), 0, short))


def test_a_limit_is_kept():
    line = Line(rate=1e6, limit=20_000.0)
    line.put(Importance.CLOUDS, 1, 1_000_000)
    line.run(10)
    assert 0.9 * 20_000 < line.ground.bytes / 10 < 1.02 * 20_000


@pytest.mark.parametrize(
    ('rate', 'delay', 'loss', 'cloud'),
    [
        (1_250_000.0, 0.02, 0.005, 90_000),
        (250_000.0, 0.05, 0.02, 30_000),
        (32_000.0, 0.1, 0.05, 4_000),
        (7_200.0, 0.2, 0.05, 1_000),
    ],
)
def test_a_minute_without_the_radio_on_each_link(rate, delay, loss, cloud):
    line = Line(rate=rate, delay=delay, loss=loss)
    for second in range(70):
        line.up = not 5 <= second < 65
        line.put(Importance.CLOUDS, 10 * second, cloud, topic='points')
        line.put(Importance.POSES, 10 * second + 1, 100, topic='tagged/pose')
        line.put(Importance.DENTS, 10 * second + 2, 300, topic='dents/list', latest=True)
        line.run(1.0, step=0.02)
    line.run(90.0, step=0.02)
    names = [(item.importance, item.stamp_ns) for item in line.items]
    assert len(names) == len(set(names))
    for importance in (Importance.POSES, Importance.CLOUDS):
        assert len(stamps(line.items, importance)) == 70
    assert stamps(line.items, Importance.DENTS)[-1] == 692
    # Of what waited for the radio the poses come before the clouds.
    kept = [
        item.importance
        for item in line.items
        if item.importance != Importance.DENTS and 60 <= item.stamp_ns < 630
    ]
    last_pose = max(index for index, each in enumerate(kept) if each == Importance.POSES)
    assert last_pose < 70


def test_what_is_replaced_in_a_long_silence_does_not_pile_up():
    line = Line()
    line.up = False
    sent = len(line.pieces)
    for stamp in range(5000):
        line.put(Importance.PREVIEWS, stamp, 10, topic='preview')
        if stamp % 1000 == 0:
            line.run(2.0, step=0.02)
    assert len(line.pieces) - sent < 64 and line.feed.silence > SILENCE
    assert len(line.store) < 5 and len(line.feed._waiting) < 1005
    line.up = True
    assert len(stamps(line.run(5), Importance.PREVIEWS)) < 6 and line.items[-1].stamp_ns == 4999


def test_a_ground_that_starts_anew_gets_what_it_had_in_part():
    line = Line(rate=20_000.0)
    line.put(Importance.CLOUDS, 1, 100_000)
    line.run(2)
    line.start_ground_anew()
    line.run(10)
    assert stamps(line.items, Importance.CLOUDS) == [1] and len(line.store) == 0


def test_a_drone_that_starts_anew_sends_what_it_had_kept(tmp_path):
    line = Line(tmp_path)
    for stamp in range(5):
        line.put(Importance.CLOUDS, stamp, 3000)
        line.put(Importance.DENTS, stamp, 100, topic='list', latest=True)
    half = Item(Importance.CLOUDS, 't', 'k', 9, b'half').pack()[:-1]
    (tmp_path / '4_9_7.item').write_bytes(half)
    (tmp_path / '4_8_6.item').write_bytes(b'damaged')
    again = Line(tmp_path)
    for kept in again.store:
        again.feed.offer(kept)
    again.run(5)
    assert sorted(stamps(again.items, Importance.CLOUDS)) == list(range(5))
    assert stamps(again.items, Importance.DENTS) == []
    assert again.store.dropped == 2 and list(tmp_path.iterdir()) == []


def test_without_room_the_least_important_and_oldest_go(tmp_path):
    store = Store(tmp_path, 20_000)
    for stamp in range(10):
        store.put(Item(Importance.PICTURES, 'p', 'k', stamp, bytes(3000)))
        store.put(Item(Importance.POSES, 'o', 'k', stamp, bytes(100)))
    assert store.size <= 20_000 and store.waiting(Importance.POSES) == 10
    left = sorted(kept.stamp_ns for kept in store if kept.importance == Importance.PICTURES)
    assert left == list(range(10 - len(left), 10)) and store.dropped == 10 - len(left)


def test_on_a_full_disk_items_stay_in_memory(tmp_path, monkeypatch):
    store = Store(tmp_path, 10**9)
    with monkeypatch.context() as patch:
        patch.setattr(
            Path, 'write_bytes', lambda *_: os.write(os.open('/dev/full', os.O_RDWR), b'x')
        )
        kept = store.put(Item(Importance.DENTS, 'dents', 'k', 1, bytes(20_000)))
    assert store.unwritten == 1 and len(store.read(kept)) > 20_000
    store.put(Item(Importance.DENTS, 'dents', 'k', 2, bytes(20_000)))
    assert store.unwritten == 1 and len(list(tmp_path.iterdir())) == 1


def test_messages_that_are_none_are_refused():
    piece = Piece(2, 3, 4, 10, 5, b'abcde')
    assert Piece.unpack(piece.pack()) == piece
    report = Report(GROUND, 5, 7, 6, 0b1011)
    assert Report.unpack(report.pack()) == report
    chance = random.Random(3)
    for data in (piece.pack(), report.pack()):
        for size in range(len(data)):
            with pytest.raises(CodecError):
                Piece.unpack(data[:size] if size < 29 else b'')
            with pytest.raises(CodecError):
                Report.unpack(data[:size])
    for _ in range(2000):
        noise = chance.randbytes(chance.randrange(200))
        for kind in (Piece, Report):
            with pytest.raises(CodecError):
                kind.unpack(noise)
    with pytest.raises(CodecError):
        Item.unpack(Item(Importance.STATE, 't', 'k', 1, b'abc').pack()[:-1])


def test_what_the_ground_holds_is_bounded():
    ground = Assembly(GROUND, 1)
    for number in range(500):
        ground.add(Piece(number, 1, number + 1, 8_000_000, 0, b'x'))
    assert ground.unfinished <= 64 and ground._held <= 64 << 20
    replayed = deflate(Item(Importance.DENTS, 't', 'k', 1, b'abc').pack())
    piece = Piece(501, 1, 900, len(replayed), 0, replayed)
    assert ground.add(piece) is not None
    assert [ground.add(piece) for _ in range(5)] == [None] * 5


def test_a_list_that_a_newer_one_has_overtaken_is_of_no_use():
    ground = Assembly(GROUND, 1)

    def came(name, link=1):
        whole = deflate(Item(Importance.DENTS, 'list', 'k', name, b'', latest=True).pack())
        return ground.add(Piece(name, link, name, len(whole), 0, whole))

    assert came(8).stamp_ns == 8 and came(7) is None and came(9).stamp_ns == 9
    # Another start of the drone counts from elsewhere.
    assert came(3, link=2).stamp_ns == 3


def test_minutes_of_a_full_link_do_not_fill_its_buffer():
    line = Line(rate=30_000.0, delay=0.1)
    line.put(Importance.CLOUDS, 1, 30_000_000)
    waits = []
    for _ in range(120):
        line.run(1.0, step=0.01)
        waits.append(line._free - line.time)
    assert max(waits[10:]) < 0.25 and line.ground.bytes > 0.85 * 120 * line.rate


def test_a_link_that_gets_slower_is_known_for_it_in_seconds():
    line = Line(rate=250_000.0)
    line.put(Importance.CLOUDS, 1, 30_000_000)
    line.run(5)
    line.rate = 30_000.0
    line.run(10)
    assert line._free - line.time < 0.25
