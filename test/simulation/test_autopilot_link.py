"""The autopilot's end of a link, with sockets that come and go at the other."""

import socket

import pytest

from ftp_dent_ros.errors import ConfigurationError, LinkError
from ftp_dent_ros.simulation.autopilot import AutopilotLink, mavlink

PING = mavlink.MAVLink_timesync_message(0, 7)


def frame(message=PING):
    return message.pack(mavlink.MAVLink(None, 1, 191))


def received(link, tries=200):
    """The next message, which is on its way."""
    for _ in range(tries):
        for message in link.receive(0.1):
            return message
    raise AssertionError('nothing came')


def parsed(data):
    return mavlink.MAVLink(None).parse_buffer(data)


@pytest.fixture
def free_port():
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


@pytest.fixture
def client():
    """A UDP or TCP socket at a port, closed in the end."""
    sockets = []

    def connect(port, kind=socket.SOCK_STREAM):
        sockets.append(socket.socket(type=kind))
        sockets[-1].settimeout(10)
        sockets[-1].connect(('127.0.0.1', port))
        return sockets[-1]

    yield connect
    for each in sockets:
        each.close()


def test_a_tcp_server_serves_one_client_after_the_other(free_port, client):
    link = AutopilotLink(f'tcpin:127.0.0.1:{free_port}', 5)
    link.send(PING)  # To nobody.
    for _ in range(3):
        peer = client(free_port)
        peer.sendall(b'garbage' + frame() + frame()[:9])
        assert received(link).ts1 == 7
        link.send(PING)
        (message,) = parsed(peer.recv(1000))
        assert (message.get_srcSystem(), message.get_srcComponent()) == (5, 1)
        peer.close()
        link.send(PING)


def test_a_tcp_server_that_comes_back_is_found_again():
    with socket.create_server(('127.0.0.1', 0)) as server:
        server.settimeout(10)
        port = server.getsockname()[1]
        link = AutopilotLink(f'tcp:127.0.0.1:{port}', 1)
        server.accept()[0].close()
    for _ in link.receive(5):
        raise AssertionError('nobody spoke')
    link.send(PING)
    with socket.create_server(('127.0.0.1', port)) as server:
        server.setblocking(False)
        for _ in range(200):
            assert not list(link.receive(0.05))
            try:
                peer, _ = server.accept()
                break
            except BlockingIOError:
                continue
        with peer:
            peer.sendall(frame())
            assert received(link).ts1 == 7


def test_a_udp_server_answers_all_who_speak_and_survives_who_leave(free_port, client):
    link = AutopilotLink(f'udpin:127.0.0.1:{free_port}', 1)
    gone, stays = (client(free_port, socket.SOCK_DGRAM) for _ in range(2))
    for peer in (gone, stays):
        peer.send(frame()[:12])
        peer.send(frame())
        assert received(link).ts1 == 7
    gone.close()
    for _ in range(3):
        link.send(PING)
        assert parsed(stays.recv(1000))[0].ts1 == 7
    stays.send(frame())
    assert received(link).ts1 == 7


@pytest.mark.parametrize('kind', ['udpin', 'tcpin'])
def test_an_address_in_use_is_refused(free_port, kind):
    address = f'{kind}:127.0.0.1:{free_port}'
    first = AutopilotLink(address, 1)
    with pytest.raises(LinkError, match=r'another program listens there: stop it') as refusal:
        AutopilotLink(address, 1)
    assert str(refusal.value).startswith(address)
    assert first.system_id == 1


def test_a_server_that_is_not_there_is_refused(free_port):
    with pytest.raises(LinkError, match=r'cannot be opened .*refused'):
        AutopilotLink(f'tcp:127.0.0.1:{free_port}', 1)


@pytest.mark.parametrize(
    'address', ['', 'nowhere', 'udp:1.2.3.4:5', 'udpin:127.0.0.1', 'tcp:a b:1', 'tcpin:h:0']
)
def test_what_is_no_address_is_refused(address):
    with pytest.raises(ConfigurationError, match='no address: give udpout:HOST:PORT'):
        AutopilotLink(address, 1)
