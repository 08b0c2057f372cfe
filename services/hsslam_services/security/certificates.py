"""A private CA, new or read from a folder, and the certificates that it issues."""

import datetime
import ipaddress
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from hsslam_node.errors import UserError
from hsslam_services.security.credentials import CA_FILE, KEY_FILE

_CLOCKS_DIFFER = datetime.timedelta(hours=1)
_CA_LIVES_LONGER = 10  # factor
_EXPECTED = "expected the folder ca of hsslam-certs"
_SIGNS = x509.KeyUsage(
    digital_signature=False,
    content_commitment=False,
    key_encipherment=False,
    data_encipherment=False,
    key_agreement=False,
    key_cert_sign=True,
    crl_sign=True,
    encipher_only=False,
    decipher_only=False,
)


class CertificateAuthority:
    """A CA; `issue` makes keys and certificates: ECDSA on P-256, as PEM.

    `days`: validity of the certificates that it issues; a new CA is valid ten times as long.
    """

    def __init__(
        self, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey, days: int
    ) -> None:
        self._certificate = certificate
        self._key = key
        self._days = days

    @classmethod
    def new(cls, days: int) -> "CertificateAuthority":
        """A CA with a new key."""
        key, name = ec.generate_private_key(ec.SECP256R1()), _name("HS-SLAM CA")
        certificate = (
            _begun(name, name, key.public_key(), _CA_LIVES_LONGER * days)
            .add_extension(x509.BasicConstraints(True, 0), critical=True)
            .add_extension(_SIGNS, critical=True)
            .sign(key, hashes.SHA256())
        )
        return cls(certificate, key, days)

    @classmethod
    def read(cls, folder: Path, days: int) -> "CertificateAuthority":
        """The CA in the folder of an option `--ca`.

        Raises:
            UserError: a file is missing or damaged, the key does not fit, or the CA would end before the
                certificates that it issues.
        """
        try:
            certificate = x509.load_pem_x509_certificate((folder / CA_FILE).read_bytes())
            key = load_pem_private_key((folder / KEY_FILE).read_bytes(), None)
        except OSError as error:
            name = Path(error.filename).name
            raise UserError(f"--ca {folder}: {name}: {error.strerror}: {_EXPECTED}") from None
        except (ValueError, TypeError):
            raise UserError(
                f"--ca {folder}: cannot be read: expected {CA_FILE} and {KEY_FILE} as PEM"
            ) from None
        if (
            not isinstance(key, ec.EllipticCurvePrivateKey)
            or key.public_key() != certificate.public_key()
        ):
            raise UserError(f"--ca {folder}: {KEY_FILE} is not the key of {CA_FILE}: {_EXPECTED}")
        ends, needed = certificate.not_valid_after_utc, _now() + datetime.timedelta(days=days)
        if ends < needed:
            raise UserError(
                f"--ca {folder}: ends on {ends:%Y-%m-%d %H:%M} UTC: expected {needed:%Y-%m-%d %H:%M} UTC "
                f"or later, for --days {days}; without --ca a new CA is made"
            )
        return cls(certificate, key, days)

    @property
    def certificate_pem(self) -> bytes:
        """The certificate of the CA, which clients and router trust."""
        return self._certificate.public_bytes(Encoding.PEM)

    @property
    def key_pem(self) -> bytes:
        """The key that signs; its owner can admit clients."""
        return _pem(self._key)

    def issue(self, name: str, hosts: Sequence[str] = ()) -> tuple[bytes, bytes]:
        """Certificate and key: of a server at `hosts` (names, addresses), or of a client if that is empty."""
        key = ec.generate_private_key(ec.SECP256R1())
        usage = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
        names = [_host(host) for host in hosts] or [x509.DNSName(name)]
        certificate = (
            _begun(_name(name), self._certificate.subject, key.public_key(), self._days)
            .add_extension(x509.BasicConstraints(False, None), critical=True)
            .add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
            .add_extension(x509.SubjectAlternativeName(names), critical=False)
            .sign(self._key, hashes.SHA256())
        )
        return certificate.public_bytes(Encoding.PEM), _pem(key)


def _begun(
    name: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = _now()
    return (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCKS_DIFFER)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
