"""Certificates, and a router that asks for them."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest

from hsslam_services.bus.bus import free_endpoint
from hsslam_services.commands.certs import make_certificates
from hsslam_services.run.options import ServeOptions
from hsslam_services.supervisor.router import open_run_router


@dataclasses.dataclass(frozen=True)
class SecureRouter:
    """Of a run with `zenoh:`. `inside`: for its own processes; `outside`: for others, with a certificate."""

    inside: str
    outside: str
    certs: Path


@pytest.fixture(scope="session")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of `hsslam-certs`."""
    folder = tmp_path_factory.mktemp("certificates") / "ours"
    make_certificates(folder, (), 7)
    return folder


@pytest.fixture
def other_certs(tmp_path: Path) -> Path:
    """The same of another CA."""
    make_certificates(tmp_path / "theirs", (), 7)
    return tmp_path / "theirs"


@pytest.fixture
def secure_router(certs: Path, tmp_path: Path) -> Iterator[SecureRouter]:
    port = int(free_endpoint().rpartition(":")[2])
    options = ServeOptions("zenoh:", zenoh_port=port, robot="r", security=str(certs / "router"))
    router = open_run_router(options, tmp_path)
    yield SecureRouter(router.endpoint, f"tls/127.0.0.1:{port}", certs)
    router.session.close()
