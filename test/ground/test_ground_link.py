"""Both ends over a real Zenoh, on this machine."""

import itertools
import json
import random
import shutil
import threading
import time

import pytest

pytest.importorskip('zenoh', reason='Zenoh is not installed: the link to the ground is not tested')

from free_address import free_address

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.ground.commands import Answer, Executive, give_command
from ftp_dent_ros.ground.drone import Drone
from ftp_dent_ros.ground.link import GroundLink, Security, endpoints
from ftp_dent_ros.ground.protocol import Importance, Item, Piece, Report, deflate
from ftp_dent_ros.ground.station import Station

NO_KEYS = Security()


@pytest.fixture
def address():
    return free_address()


@pytest.fixture(scope='module')
def keys(tmp_path_factory):
    pytest.importorskip('cryptography', reason='cryptography is not installed: no keys are made')
    from ftp_dent_ros.ground.link import make_keys

    folder = tmp_path_factory.mktemp('keys')
    make_keys(folder)
    with pytest.raises(ConfigurationError, match='holds files already'):
        make_keys(folder)
    assert all(path.stat().st_mode & 0o77 == 0 for path in folder.iterdir())
    return folder


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, 'not reached'
        time.sleep(0.02)


def drone_at(address, security=NO_KEYS, folder=None, does=None):
    return Drone(GroundLink('drone', address, security), folder, 10**8, 0.0, Executive(does or {}))


def station_at(address, take, name='one', security=NO_KEYS):
    return Station(GroundLink('ground', address, security), take, name)


def cloud(stamp):
    return Item(Importance.CLOUDS, 'points', 'k', stamp, random.Random(stamp).randbytes(20_000))


def dents(stamp):
    return Item(Importance.DENTS, 'dents/list', 'k', stamp, b'list', latest=True)


def test_the_payload_does_not_wait_for_a_link_that_is_dead(address, tmp_path):
    drone = drone_at(address, folder=tmp_path)
    for stamp in range(50):
        drone.put(cloud(stamp))
    assert int(drone.state()['waiting: clouds']) == 50 and threading.active_count() < 50
    drone.close()
    assert len(list(tmp_path.iterdir())) == 50


def test_two_grounds_and_one_that_comes_late(address):
    one, two = [], []
    drone, first = drone_at(address), station_at(address, one.append)
    drone.put(dents(1))
    for stamp in range(5):
        drone.put(cloud(stamp))
    until(lambda: len(one) == 6)
    second = station_at(address, two.append, 'two')
    # The latched list is there for who comes late, what was delivered is not sent again.
    until(lambda: len(two) == 1)
    drone.put(cloud(9))
    until(lambda: len(one) == 7 and len(two) == 2)
    assert two[0].topic == 'dents/list' and two[1].stamp_ns == 9
    assert drone.state()['grounds'] == '2'
    for end in (first, second, drone):
        end.close()


def test_two_grounds_of_one_name_are_told_and_one_is_served(address):
    drone, came = drone_at(address), ([], [])
    first, second = (station_at(address, each.append) for each in came)
    until(lambda: 'same name' in drone.trouble())
    for stamp in range(10):
        drone.put(cloud(stamp))
    until(lambda: max(map(len, came)) == 10 and not drone.state()['waiting: clouds'].strip('0'))
    second.close()
    # Whichever it was: the other one goes on.
    until(lambda: not drone.trouble())
    drone.put(cloud(11))
    until(lambda: came[0][-1].stamp_ns == 11)
    first.close()
    drone.close()


def test_either_end_may_start_anew_and_nothing_comes_twice(address, tmp_path):
    got = []
    drone = drone_at(address, folder=tmp_path)
    for stamp in range(3):
        drone.put(cloud(stamp))
    drone.close()
    drone = drone_at(address, folder=tmp_path)
    drone.put(cloud(3))
    station = station_at(address, got.append)
    until(lambda: len(got) == 4)
    station.close()
    drone.put(cloud(4))
    station = station_at(address, got.append)
    until(lambda: len(got) == 5)
    assert sorted(item.stamp_ns for item in got) == list(range(5))
    until(lambda: not list(tmp_path.iterdir()))
    station.close()
    drone.close()


def test_commands_are_done_once_and_answered(address):
    done = []

    def capture():
        done.append(1)
        return Answer(True, 'photograph taken')

    drone = drone_at(address, does={'capture': capture})
    link = GroundLink('ground', address, Security())
    assert give_command(link, 'capture', patience=120.0) == Answer(True, 'photograph taken')
    request = b'capture ' + b'0' * 32
    executive = Executive({'capture': capture})
    assert len({executive.reply(request) for _ in range(5)}) == 1 and len(done) == 2
    for nonsense in (b'', b'[]', b'fly ' + b'0' * 32, b'\xff' * 9999, b'[' * 2000):
        assert not json.loads(executive.reply(nonsense))['success']
    assert len(done) == 2
    assert not give_command(link, 'take_list').success
    drone.close()
    answer = give_command(link, 'capture', patience=0.5)
    assert not answer.success and 'no answer' in answer.message
    link.close()


def test_with_keys_nobody_else_gets_in(address, keys, tmp_path):
    from ftp_dent_ros.ground.link import make_keys

    got, strangers = [], []
    secure = Security(keys)
    drone = drone_at(address, secure)
    station = station_at(address, got.append, security=secure)
    drone.put(cloud(1))
    until(lambda: got)
    make_keys(tmp_path / 'others')
    # Without keys, with others', and with the drone's own in a ground's place.
    swapped = tmp_path / 'swapped'
    swapped.mkdir()
    for end in ('pem', 'key'):
        (swapped / f'ground.{end}').write_bytes((keys / f'drone.{end}').read_bytes())
    (swapped / 'authority.pem').write_bytes((keys / 'authority.pem').read_bytes())
    others = [Security(), Security(tmp_path / 'others'), Security(swapped)]
    ends = [station_at(address, strangers.append, 'x', each) for each in others]
    drone.put(cloud(2))
    until(lambda: len(got) == 2)
    assert not strangers and drone.state()['grounds'] == '1'
    link = GroundLink('ground', address, Security(tmp_path / 'others'))
    assert not give_command(link, 'capture', patience=0.5).success
    for end in (link, *ends, station, drone):
        end.close()


@pytest.mark.parametrize('is_secure', [False, True])
def test_where_no_datagrams_pass_a_stream_does(address, keys, is_secure):
    got = []
    security = Security(keys) if is_secure else Security()
    drone = drone_at(address, security)
    station = station_at(f'tcp/{address}', got.append, security=security)
    drone.put(cloud(1))
    until(lambda: got)
    station.close()
    drone.close()


def test_noise_and_replays_from_one_who_is_in(address):
    got = []
    drone, station = drone_at(address), station_at(address, got.append)
    pieces = []
    rogue = GroundLink('ground', address, Security())
    rogue.on('down/*', pieces.append)
    drone.put(cloud(1))
    until(lambda: got)
    chance = random.Random(1)
    name = itertools.count()

    def noise():
        # Datagrams may be lost: there is more until enough of it has come.
        for _ in range(5):
            rogue.send('up', chance.randbytes(chance.randrange(100)))
            rogue.send('command', chance.randbytes(50))
            # Many grounds that are none: only so many are remembered.
            rogue.send('up', Report(next(name).to_bytes(16, 'big'), 1, 0, 0, 0).pack())
        return int(drone.state()['refused']) >= 200

    until(noise)
    drone.put(cloud(2))
    until(lambda: len(got) == 2)
    assert len(drone._feeds) <= 8
    # What was heard is played to the station again, truncated, and made up.
    for data in [*pieces, *(each[:40] for each in pieces[:20])]:
        station._take(data)
    made_up = deflate(Item(Importance.STATE, 't', 'k', 1, b'x').pack()[:-1] + b'?')
    station._take(Piece(5, 1, 1, len(made_up), 0, made_up).pack())
    assert len(got) == 2 and station.refused >= 1
    for end in (rogue, station, drone):
        end.close()


def test_the_link_is_told_as_it_comes_and_goes(address):
    station = station_at(address, lambda item: None)
    assert station.change().startswith('nothing has come from the drone yet: ')
    assert not station.change()
    drone = drone_at(address)
    drone.put(dents(1))
    until(lambda: station.change() == 'the link to the drone works')
    drone.close()
    until(lambda: station.change().startswith('nothing has come from the drone for '))
    station.close()


def test_addresses_and_refusals(keys, tmp_path):
    both = ['udp/localhost:7447', 'tcp/localhost:7447']
    assert endpoints('localhost', Security(), 'drone') == both
    assert endpoints('[::1]:5', Security(), 'ground') == ['udp/[::1]:5']
    assert endpoints('tcp/[::1]:5', Security(), 'ground') == ['tcp/[::1]:5']
    assert endpoints('10.0.0.1:5', Security(keys), 'ground') == ['quic/10.0.0.1:5?rel=0']
    assert endpoints('tcp/10.0.0.1:5', Security(keys), 'ground') == ['tls/10.0.0.1:5']
    assert endpoints('10.0.0.1:5', Security(open=True), 'ground') == ['udp/10.0.0.1:5']
    for wrong in ('', 'a b', 'host:99999', 'host:x', '::1', 'udp/host:1', 'tcp/host:1'):
        with pytest.raises(ConfigurationError, match='no address'):
            endpoints(wrong, Security(open=True), 'drone')
    with pytest.raises(ConfigurationError, match='without keys anybody'):
        endpoints('0.0.0.0', Security(), 'drone')
    with pytest.raises(ConfigurationError, match=r'ground\.key are not there: make keys'):
        endpoints('10.0.0.1', Security(keys / 'nowhere'), 'ground')
    others = (keys / 'drone.pem').read_bytes()
    for spoilt, text in (('ground.key', b'rubbish'), ('ground.pem', others)):
        folder = tmp_path / spoilt
        shutil.copytree(keys, folder)
        (folder / spoilt).write_bytes(text)
        with pytest.raises(ConfigurationError, match='are no keys of one end: make keys'):
            endpoints('10.0.0.1', Security(folder), 'ground')
        assert endpoints('10.0.0.1', Security(folder), 'drone')
