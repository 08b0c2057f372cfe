"""`hsslam-certs`: a CA and a certificate for each role, in folders that `--security` takes."""

import os
import socket
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hsslam_node.errors import UserError
from hsslam_node.services.exit_code import exit_code
from hsslam_node.services.parse_options import parse_options
from hsslam_node.services.security.access import ROLES
from hsslam_node.services.security.certificates import CertificateAuthority
from hsslam_node.services.security.certs_options import CertsOptions
from hsslam_node.services.security.credentials import CA_FILE, CERTIFICATE_FILE, KEY_FILE, ROUTER

_PROG = "hsslam-certs"
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


def main(args: Sequence[str] | None = None) -> None:
    """Exit code 0: made; 2: bad input."""
    given = sys.argv[1:] if args is None else args
    if code := exit_code(lambda: _certs(parse_options(CertsOptions, _PROG, given))):
        sys.exit(code)


def make_certificates(folder: Path, hosts: Sequence[str], days: int) -> list[str]:
    """Make them all, in a folder that is new or empty; returns the hosts of the router's certificate.

    Raises:
        UserError: there is something already, or it cannot be written.
    """
    authority = CertificateAuthority(days)
    every = list(dict.fromkeys((*_LOOPBACK, socket.gethostname(), *hosts)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise UserError(f"{folder}: holds something already: expected a new folder")
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
    folder = Path(options.folder)
    hosts = make_certificates(folder, options.host, options.days)
    table = Table("folder", "for")
    table.add_row(f"{folder}/ca", "nobody: with its key more certificates can be made")
    table.add_row(f"{folder}/{ROUTER}", "hsslam-serve --security")
    for role in ROLES:
        table.add_row(f"{folder}/{role.name}", role.purpose)
    Console(emoji=False, highlight=False, markup=False).print(table)
    print(f"valid for {options.days} days; the router is known as {', '.join(hosts)}")


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files that only their owner can read, in a folder that only he can enter."""
    folder.mkdir(mode=0o700)
    for name, data in files.items():
        fd = os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(fd, "wb") as file:
            file.write(data)


if __name__ == "__main__":
    main()
