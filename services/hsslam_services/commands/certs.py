"""`hsslam-certs`: a CA and a certificate for each role, in folders that `--security` takes."""

import ipaddress
import os
import re
import socket
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from rich.console import Console
from rich.table import Table

from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_services.commands.cli import exit_code, parse_options
from hsslam_services.security.access import ROLES
from hsslam_services.security.certificates import CertificateAuthority
from hsslam_services.security.credentials import CA_FILE, CERTIFICATE_FILE, KEY_FILE, ROUTER

_NAME = r"(?=.{1,253}$)[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?(\.[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?)*"
_PROG = "hsslam-certs"
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True)
class CertsOptions:
    """Makes certificates for a service that other machines connect to.

    Examples:
      hsslam-certs certs --host 10.0.0.7 robot.local
      hsslam-serve --bind 0.0.0.0 --security certs/router
      hsslam-ctl status --connect tls/10.0.0.7:7447 --security certs/operator
      hsslam-certs certs/next --ca certs/ca --host 10.0.0.7 robot.local

    DIR gets one folder each for the certificate authority (CA), the router and the roles camera, viewer and
    operator. Each folder is complete: copy it to the machine that needs it and to no other. Only the owner
    of the files can read the keys.

    --ca renews: the CA in that folder issues the new certificates. Old and new ones accept each other, so
    machines may change one by one. DIR then gets no folder ca.

    Exit codes: 0 if the certificates are made, 2 if the input is bad.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("folder",)
    VALUES: ClassVar = {"folder": "DIR", "host": "HOST...", "ca": "FOLDER"}

    folder: str = ""
    """New folder for the certificates."""
    host: tuple[str, ...] = ()
    """Names and addresses that clients use for the router, besides this machine's name and loopback."""
    days: int = 90
    """Validity of the certificates, days; a new CA is valid ten times as long."""
    ca: Path | None = None
    """Folder ca of earlier certificates; its CA issues the new ones (none: a new CA)."""

    def __post_init__(self) -> None:
        for host in self.host:
            if not _is_host(host):
                raise UserError(f"--host {host}: expected names or addresses, without a port")
        if not 1 <= self.days <= 3650:
            raise UserError(f"--days {self.days}: expected 1 to 3650")


def _is_host(text: str) -> bool:
    """Whether this is a name or an address that a certificate may have."""
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return re.fullmatch(_NAME, text) is not None
    return True


def main(args: Sequence[str] | None = None) -> None:
    """Run the command; exit code 0 or 2, see `CertsOptions`."""
    given = sys.argv[1:] if args is None else args
    if code := exit_code(lambda: _certs(parse_options(CertsOptions, _PROG, given))):
        sys.exit(code)


def make_certificates(
    folder: Path, hosts: Sequence[str], days: int, ca: Path | None = None
) -> list[str]:
    """Make all certificates in a new or empty folder; returns the hosts of the router's certificate.

    `ca`: folder of the CA that issues them; None: a new CA, written to the subfolder `ca`.

    Raises:
        UserError: the folder is not empty, or cannot be written; the CA cannot issue them.
    """
    authority = CertificateAuthority.read(ca, days) if ca else CertificateAuthority.new(days)
    own = filter(_is_host, [socket.gethostname()])  # certificates have no other names
    every = list(dict.fromkeys((*_LOOPBACK, *own, *hosts)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise UserError(f"{folder}: is not empty: expected a new folder")
        if ca is None:
            _write(folder / "ca", {CA_FILE: authority.certificate_pem, KEY_FILE: authority.key_pem})
        for name in (ROUTER, *(role.name for role in ROLES)):
            certificate, key = authority.issue(name, every if name == ROUTER else ())
            files = {
                CA_FILE: authority.certificate_pem,
                CERTIFICATE_FILE: certificate,
                KEY_FILE: key,
            }
            _write(folder / name, files)
    except OSError as error:
        raise UserError(
            f"{folder}: {error.strerror}: expected a folder that can be written"
        ) from None
    return every


def _certs(options: CertsOptions) -> None:
    if not options.folder:
        raise UserError(f"no folder: expected {_PROG} DIR")
    folder = user_path(options.folder)
    hosts = make_certificates(folder, options.host, options.days, options.ca)
    table = Table("folder", "for")
    if options.ca is None:
        table.add_row(f"{folder}/ca", "copy it to no machine: --ca needs it for more certificates")
    table.add_row(f"{folder}/{ROUTER}", "hsslam-serve --security")
    for role in ROLES:
        table.add_row(f"{folder}/{role.name}", role.purpose)
    Console(emoji=False, highlight=False, markup=False).print(table)
    print(f"valid for {options.days} days; the router is known as {', '.join(hosts)}")


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files that only their owner can read, in a folder that only the owner can enter."""
    folder.mkdir(mode=0o700)
    for name, data in files.items():
        fd = os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(fd, "wb") as file:
            file.write(data)


if __name__ == "__main__":
    main()
