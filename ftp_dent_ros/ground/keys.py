"""Keys by which drone and ground know each other: a private authority, and a certificate each."""

from __future__ import annotations

import datetime
import os
import shutil
import ssl
from pathlib import Path

from ftp_dent_ros.errors import ConfigurationError

AUTHORITY = 'authority.pem'
ROLES = ('drone', 'ground')
_YEARS = 10


def make_keys(folder: Path) -> list[Path]:
    """Make ``authority.pem`` and, for each end, ``ROLE.pem`` and ``ROLE.key``; return the paths.

    The authority's own key is kept nowhere: more ends need new keys for all. A ground's
    certificate cannot pass for the drone's, nor the other way round.

    Raises
    ------
    ConfigurationError
        The folder is not empty or cannot be written, or `cryptography` is not installed.
    """
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
        from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
    except ModuleNotFoundError:
        raise ConfigurationError(
            "keys need the Python package cryptography: install it with `pip install '.[ground]'` "
            'or, on Ubuntu, `apt install python3-cryptography`'
        ) from None
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
            .not_valid_after(now + datetime.timedelta(days=365 * _YEARS))
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
    # All of them are there under the folder's name, of one authority, or none.
    whole = Path(os.path.abspath(folder))
    aside = whole.with_name(f'.{whole.name}.{os.getpid()}')
    try:
        whole.parent.mkdir(parents=True, exist_ok=True)
        aside.mkdir(mode=0o700)
        for file, data in contents.items():
            descriptor = os.open(aside / file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, 'wb') as written:
                written.write(data)
        aside.rename(whole)
    except OSError as reason:
        raise ConfigurationError(
            f'{folder}: keys cannot be written ({reason.strerror}): choose another folder'
        ) from None
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return [folder / file for file in contents]


def require_pair(folder: Path, role: str) -> None:
    """Raise ConfigurationError unless an end's files are a certificate, its key and an authority.

    With others the connection would never come about, and nobody would say why.
    """
    certificate, key = f'{role}.pem', f'{role}.key'
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(folder / AUTHORITY)
        # A password that is not asked for at the terminal.
        context.load_cert_chain(folder / certificate, folder / key, password='')
    except (ssl.SSLError, OSError):
        raise ConfigurationError(
            f'{folder}: {AUTHORITY}, {certificate} and {key} are no keys of one end: copy them '
            'anew from where `ftp-dent ground --make-keys DIR` made them'
        ) from None
