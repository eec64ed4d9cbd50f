"""The command before take-off, with an autopilot at the other end of a real socket."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest
from hovering_autopilot import HoveringAutopilot, Wire
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.cli import link_check
from ftp_dent_ros.cli.main import main


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(link_check, '_SHORTEST', 0.1)
    monkeypatch.setattr(link_check, '_WELL', 0.1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


@pytest.fixture
def wire(port: int) -> Iterator[Wire]:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(('127.0.0.1', 0))
    yield Wire(end, ('127.0.0.1', port))
    end.close()


def test_a_link_that_is_fit_is_a_go(port, wire, capsys) -> None:
    with HoveringAutopilot(wire):
        assert main(['link-check', f'udpin:{port}']) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[-1].startswith('GO: ')
    assert '1/1    quadrotor, ardupilotmega' in out and '<- believed' in out
    assert 'ATTITUDE_QUATERNION' in out and 'LOCAL_POSITION_NED' in out
    figures = dict(line.rsplit(maxsplit=1) for line in out.splitlines() if len(line.split()) > 1)
    assert figures['  estimator'] == 'ready' and figures['  clock converged'] == 'true'
    assert '  GPS fix                                     3d fix\n' in out
    assert 'pose         3.00 m north, 2.00 m east, 1.00 m up, heading 0 degrees' in out


def refused(port: int, seconds: str, verdict: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Check until the verdict is that: a busy machine may need longer to hear what it is of."""
    out = ''
    for _ in range(20):
        assert main(['link-check', f'udpin:{port}', '--seconds', seconds]) == 1
        out = capsys.readouterr().out
        if f'NO GO: {verdict}' in out:
            break
    assert f'NO GO: {verdict}' in out
    assert 'pose         none: ' in out


def test_a_vehicle_without_gps_is_no_go_unless_that_is_said(port, wire, capsys) -> None:
    with HoveringAutopilot(wire) as autopilot:
        autopilot.fix_type = 1
        refused(port, '2', 'GPS has no fix', capsys)
        assert main(['link-check', f'udpin:{port}', '--position-source', 'other']) == 0
    beats = {(m.get_srcSystem(), m.get_srcComponent()) for m in autopilot.heard('HEARTBEAT')}
    assert beats == {(1, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)}


def test_nobody_on_the_link_is_no_go(port, capsys) -> None:
    assert main(['link-check', f'udpin:127.0.0.1:{port}', '--seconds', '0.2']) == 1
    out = capsys.readouterr().out
    assert 'nobody' in out
    assert f'NO GO: no autopilot heard on udpin:127.0.0.1:{port}' in out


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        (['udp:14550'], 'is no address of an autopilot'),
        (['udpin:14550', '--signing-key', '/nowhere/key'], 'the signing key cannot be read'),
        (['udpin:14550', '--seconds', 'inf'], '--seconds is inf: give 0 to 86400'),
    ],
)
def test_bad_usage_is_one_line(words, sentence, capsys) -> None:
    assert main(['link-check', *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert sentence in line
