"""The link itself: Zenoh between drone and ground, in datagrams, and who may use it.

The drone listens, the ground connects: by UDP, or with keys by QUIC's datagrams, which nothing
sends again but `Feed`. A stream (TCP, TLS) is in order: one lost packet holds up all that is
behind it, for seconds where a radio loses several; it is for networks that let no datagrams pass.
Pieces go down and reports up as messages, commands up as queries. Nothing is discovered: neither
multicast nor gossip leaves the machine.
"""

from __future__ import annotations

import datetime
import ipaddress
import json
import re
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ftp_dent_ros.errors import ConfigurationError

AUTHORITY = 'authority.pem'
ROLES = ('drone', 'ground')

PORT = 7447
_ADDRESS = re.compile(
    r'(?P<stream>tcp/)?(?P<host>\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+)(:(?P<port>\d{1,5}))?'
)


def is_here(host: str) -> bool:
    """Whether only this machine reaches a host: a name, or an address, in brackets or not."""
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host.strip('[]')).is_loopback
    except ValueError:
        return False


def make_keys(folder: Path) -> list[Path]:
    """Make ``authority.pem`` and, for each end, ``ROLE.pem`` and ``ROLE.key``; return the paths.

    The authority's own key is kept nowhere: more ends need new keys for all. A ground's
    certificate cannot pass for the drone's, nor the other way round.

    Raises
    ------
    ConfigurationError
        The folder is not empty or cannot be written.
    """
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigurationError(f'{folder}: holds files already: choose a new folder')

    now = datetime.datetime.now(datetime.timezone.utc)

    def name(common: str) -> x509.Name:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])

    def builder(subject: str, public) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(name(subject))
            .issuer_name(name('ftp_dent_ros'))
            .public_key(public)
            .serial_number(x509.random_serial_number())
            # A drone's clock may be behind until it has a fix.
            .not_valid_before(now - datetime.timedelta(days=365))
            .not_valid_after(now + datetime.timedelta(days=3650))
        )

    authority = ec.generate_private_key(ec.SECP256R1())
    root = (
        builder('ftp_dent_ros', authority.public_key())
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(authority, hashes.SHA256())
    )
    contents = {AUTHORITY: root.public_bytes(serialization.Encoding.PEM)}
    usages = (ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH)
    for role, usage in zip(ROLES, usages, strict=True):
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = (
            builder(role, key.public_key())
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.SubjectAlternativeName([x509.DNSName(role)]), critical=False)
            .add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
            .sign(authority, hashes.SHA256())
        )
        contents[f'{role}.pem'] = certificate.public_bytes(serialization.Encoding.PEM)
        contents[f'{role}.key'] = key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for file, data in contents.items():
            (folder / file).touch(0o600, exist_ok=False)
            (folder / file).write_bytes(data)
    except OSError as reason:
        raise ConfigurationError(
            f'{folder}: keys cannot be written ({reason.strerror}): choose another folder'
        ) from None
    return [folder / file for file in contents]


def require_pair(folder: Path, role: str) -> None:
    """Raise ConfigurationError unless an end's files are a certificate, its key and an authority.

    With others the connection would never come about, and nobody would say why.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(folder / AUTHORITY)
        # A password that is not asked for at the terminal.
        context.load_cert_chain(folder / f'{role}.pem', folder / f'{role}.key', password='')
    except OSError as reason:  # ssl.SSLError too
        what = 'not there' if isinstance(reason, FileNotFoundError) else 'no keys of one end'
        raise ConfigurationError(
            f'{folder}: {AUTHORITY}, {role}.pem and {role}.key are {what}: make keys with '
            '`ftp-dent ground --make-keys DIR` and copy them to both ends'
        ) from None


@dataclass(frozen=True)
class Security:
    """Keys of one end, or the explicit wish to do without.

    Attributes
    ----------
    keys : Path or None
        Folder that `make_keys` made, or the part of it that this end needs.
    open : bool
        Whether anybody may connect if there are no keys.
    """

    keys: Path | None = None
    open: bool = False


def endpoints(address: str, security: Security, role: str) -> list[str]:
    """Zenoh's endpoints of ``HOST``, ``HOST:PORT`` or ``[IPv6]:PORT``, the ground's with ``tcp/``.

    The drone listens for datagrams and for streams; a ground connects by the ones or, with
    ``tcp/``, by the others.

    Raises
    ------
    ConfigurationError
        The address is malformed, the keys are not there or none, or there are none although
        the address is beyond this machine.
    """
    match = _ADDRESS.fullmatch(address)
    port = int(match['port'] or PORT) if match else 0
    if match is None or not 0 < port < 65536 or (match['stream'] and role == 'drone'):
        raise ConfigurationError(f'{address!r} is no address of a link: give HOST or HOST:PORT')
    if security.keys is not None:
        require_pair(security.keys, role)
    elif not security.open and not is_here(match['host']):
        raise ConfigurationError(
            f'{address}: without keys anybody on that network could command the drone: make '
            'keys with `ftp-dent ground --make-keys DIR`, or say plainly that it is to be open'
        )
    place = f'{match["host"]}:{port}'
    datagrams, stream = (
        (f'quic/{place}?rel=0', f'tls/{place}')
        if security.keys
        else (f'udp/{place}', f'tcp/{place}')
    )
    if role == 'drone':
        return [datagrams, stream]
    return [stream if match['stream'] else datagrams]


class GroundLink:
    """One end of the link.

    Parameters
    ----------
    role : str
        ``'drone'``, which listens, or ``'ground'``, which connects.
    address : str
    security : Security
    name : str
        Of the payload: both ends use the same.

    Raises
    ------
    ConfigurationError
        As `endpoints`; or the address cannot be listened on.
    """

    def __init__(self, role: str, address: str, security: Security, name: str = 'payload') -> None:
        import zenoh

        if not re.fullmatch(r'\w+', name):
            raise ConfigurationError(f'{name!r} is no name of a link: give letters and digits')
        self._zenoh: Any = zenoh
        self._base = f'ftp_dent/{name}'
        self._held: list[Any] = []
        where = endpoints(address, security, role)
        try:
            self._session = zenoh.open(_configuration(zenoh, role, where, security))
        except zenoh.ZError as reason:
            raise ConfigurationError(
                f'{address}: cannot {"be listened on" if role == "drone" else "be reached"} '
                f'({str(reason).split(" at ")[0]}): check the address and the keys'
            ) from None

    def send(self, channel: str, data: bytes) -> None:
        """Send a message; blocks while the connection takes no more."""
        self._session.put(
            f'{self._base}/{channel}',
            data,
            congestion_control=self._zenoh.CongestionControl.BLOCK,
            priority=self._zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
        )

    def on(self, channel: str, take: Callable[[bytes], None]) -> None:
        """Call `take` with each message of a channel, in a thread of Zenoh's."""
        self._held.append(
            self._session.declare_subscriber(
                f'{self._base}/{channel}', lambda sample: take(bytes(sample.payload))
            )
        )

    def answer(self, channel: str, reply: Callable[[bytes], bytes]) -> None:
        """Answer requests, in a thread of Zenoh's."""

        def take(query: Any) -> None:
            given = bytes(query.payload) if query.payload is not None else b''
            query.reply(query.key_expr, reply(given))

        self._held.append(self._session.declare_queryable(f'{self._base}/{channel}', take))

    def ask(self, channel: str, data: bytes, seconds: float) -> bytes | None:
        """Answer to a request, or None if there is none in that time."""
        for reply in self._session.get(f'{self._base}/{channel}', payload=data, timeout=seconds):
            if reply.ok is not None:
                return bytes(reply.ok.payload)
        return None

    def close(self) -> None:
        """End the connection; a second time changes nothing."""
        if self._session.is_closed():
            return
        for each in self._held:
            each.undeclare()
        self._session.close()


def _configuration(zenoh: Any, role: str, where: list[str], security: Security) -> Any:
    settings: dict[str, Any] = {
        'mode': 'peer',
        'scouting/multicast/enabled': False,
        'scouting/gossip/enabled': False,
        # ms for a connection to be made: a datagram of the plain handshake is not sent again; that
        # of keys is longer, and QUIC and TCP send it again.
        'transport/unicast/open_timeout': 4000 if security.keys else 1500,
        # ms without a sign of life after which a connection is given up: a new one is faster than
        # a stream's own patience, which doubles with each loss.
        'transport/link/tx/lease': 6000,
        'transport/link/tx/keep_alive': 3,
        # What waits in queues here cannot be overtaken.
        'transport/link/rx/max_message_size': 1 << 20,
    }
    if role == 'drone':
        settings |= {'listen/endpoints': where, 'transport/unicast/max_sessions': 16}
    else:
        settings |= {
            'listen/endpoints': [],
            'connect/endpoints': where,
            'connect/exit_on_failure': False,
            'connect/timeout_ms': -1,
            'connect/retry': {
                'period_init_ms': 100,
                'period_max_ms': 500,
                'period_increase_factor': 1.5,
            },
        }
    if security.keys is not None:
        side = 'listen' if role == 'drone' else 'connect'
        settings['transport/link/tls'] = {
            'root_ca_certificate': str(security.keys / AUTHORITY),
            f'{side}_certificate': str(security.keys / f'{role}.pem'),
            f'{side}_private_key': str(security.keys / f'{role}.key'),
            'enable_mtls': True,
            # Its name is not an address; that it is the drone's its certificate's use says.
            'verify_name_on_connect': False,
            'close_link_on_expiration': False,
        }
    configuration = zenoh.Config()
    for key, value in settings.items():
        configuration.insert_json5(key, json.dumps(value))
    return configuration
