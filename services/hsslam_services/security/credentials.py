"""A folder with a certificate, its key and the trusted CA, and the TLS settings of zenoh for them."""

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_services.security.access import ROLES
from hsslam_services.security.certificate_validity import CertificateValidity

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

CA_FILE, CERTIFICATE_FILE, KEY_FILE = "ca.pem", "cert.pem", "key.pem"
ROUTER = "router"
_TLS = "transport/link/tls/"


@dataclass(frozen=True)
class Credentials:
    """The identity of a client or router: `name` is the common name of the certificate, which is the role."""

    folder: Path
    name: str
    validity: CertificateValidity

    @staticmethod
    def read(folder: str | Path) -> "Credentials":
        """The credentials in the folder of an option `--security`.

        Raises:
            UserError: a file is missing or not PEM; the certificate has expired, does not fit its key, or is
                not of the trusted CA.
        """
        from cryptography import x509
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

        path = user_path(folder).absolute()
        try:
            read = {
                file: (path / file).read_bytes() for file in (CA_FILE, CERTIFICATE_FILE, KEY_FILE)
            }
        except OSError as error:
            name = Path(error.filename).name
            raise UserError(
                f"--security {folder}: {name}: {error.strerror}: expected a folder of hsslam-certs"
            ) from None
        try:
            trusted = x509.load_pem_x509_certificates(read[CA_FILE])
            certificate, *others = x509.load_pem_x509_certificates(read[CERTIFICATE_FILE])
            key = load_pem_private_key(read[KEY_FILE], None)
        except (ValueError, TypeError):
            raise UserError(
                f"--security {folder}: cannot be read: expected ca.pem, cert.pem and key.pem as PEM"
            ) from None
        if key.public_key() != certificate.public_key():
            raise UserError(f"--security {folder}: key.pem is not the key of cert.pem")
        chain = _chain(certificate, others, trusted)
        if not chain:
            raise UserError(
                f"--security {folder}: the CA in ca.pem did not issue cert.pem: expected both of one CA"
            )
        begins = max(each.not_valid_before_utc for each in chain)
        ends = min(each.not_valid_after_utc for each in chain)
        if ends < datetime.datetime.now(datetime.UTC):
            raise UserError(
                f"--security {folder}: expired on {ends.date()}: expected a valid certificate"
            )
        names = certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
        name = str(names[0].value) if names else ""
        return Credentials(path, name, CertificateValidity(path, begins, ends))

    def exposure(self) -> str:
        """The warning about a key that other users of this machine can read; empty if none can."""
        mode = (self.folder / KEY_FILE).stat().st_mode & 0o777
        if not mode & 0o077:
            return ""
        return (
            f"--security {self.folder}: {KEY_FILE} has mode {mode:o}: other users may read the private key: "
            "expected mode 600"
        )

    def expect_router(self) -> None:
        """Raise UserError unless the certificate is the router's."""
        if self.name != ROUTER:
            raise UserError(
                f"--security {self.folder}: certificate of {self.name!r}: expected the router's"
            )

    def expect_outsider(self) -> None:
        """Raise UserError unless the certificate is that of a client."""
        known = [role.name for role in ROLES]
        if self.name not in known:
            raise UserError(
                f"--security {self.folder}: certificate of {self.name!r}: expected that of "
                f"{' or '.join(known)}"
            )

    def listening(self) -> dict[str, object]:
        """zenoh settings of a router that accepts only clients of its CA."""
        return {**self._certified("listen"), f"{_TLS}close_link_on_expiration": True}

    def connecting(self) -> dict[str, object]:
        """zenoh settings of a client that presents its certificate and accepts only a router of its CA."""
        return {**self._certified("connect"), f"{_TLS}verify_name_on_connect": True}

    def _certified(self, act: Literal["listen", "connect"]) -> dict[str, object]:
        return {
            f"{_TLS}root_ca_certificate": str(self.folder / CA_FILE),
            f"{_TLS}{act}_certificate": str(self.folder / CERTIFICATE_FILE),
            f"{_TLS}{act}_private_key": str(self.folder / KEY_FILE),
            f"{_TLS}enable_mtls": True,
        }


def _chain(
    certificate: "Certificate", others: "Sequence[Certificate]", trusted: "Sequence[Certificate]"
) -> "list[Certificate]":
    """The certificate, its issuer, and so on up to a trusted certificate; empty if there is no such chain.

    If a CA was renewed with the same key, the certificate of it that ends last counts.
    """
    issuers = (*sorted(trusted, key=lambda each: each.not_valid_after_utc, reverse=True), *others)
    chain = [certificate]
    while chain[-1] not in trusted:
        above = (each for each in issuers if each not in chain and _is_issued(chain[-1], each))
        if (issuer := next(above, None)) is None:
            return []
        chain.append(issuer)
    return chain


def _is_issued(certificate: "Certificate", issuer: "Certificate") -> bool:
    from cryptography.exceptions import InvalidSignature

    try:
        certificate.verify_directly_issued_by(issuer)
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def client_settings(endpoint: str, security: str) -> dict[str, object]:
    """zenoh settings of a client of `endpoint`; `security`: folder of its certificate, or "".

    Raises:
        UserError: tls without a certificate, a certificate without tls, or an unusable certificate.
    """
    is_tls = endpoint.startswith("tls/")
    if is_tls and not security:
        raise UserError(f"{endpoint}: expected --security DIR, the folder of your certificate")
    if security and not is_tls:
        raise UserError(f"--security {security}: {endpoint}: expected an endpoint tls/HOST:PORT")
    if not is_tls:
        return {}
    credentials = Credentials.read(security)
    credentials.expect_outsider()
    return credentials.connecting()
