"""Folders of credentials: what is wrong with one is told in one line."""

import shutil

import pytest

from hsslam_node.errors import UserError
from hsslam_services.commands.certs import make_certificates
from hsslam_services.run.options import ServeOptions
from hsslam_services.security.credentials import Credentials, client_settings
from hsslam_services.supervisor.router import open_run_router

_TLS = "tls/127.0.0.1:7447"


def test_a_folder_says_who_it_is_for(certs):
    assert Credentials.read(certs / "camera").name == "camera"
    assert Credentials.read(certs / "router").name == "router"


@pytest.mark.parametrize("missing", ["ca.pem", "cert.pem", "key.pem"])
def test_a_file_that_is_missing_is_named(certs, tmp_path, missing):
    folder = shutil.copytree(certs / "camera", tmp_path / "camera")
    (folder / missing).unlink()
    with pytest.raises(UserError, match=f"{missing}: No such file.*hsslam-certs"):
        Credentials.read(folder)


def test_what_is_no_certificate_or_of_another_key(certs, tmp_path):
    folder = shutil.copytree(certs / "camera", tmp_path / "camera")
    shutil.copy(certs / "viewer" / "key.pem", folder)
    with pytest.raises(UserError, match="not the key of"):
        Credentials.read(folder)
    (folder / "cert.pem").write_text("-----BEGIN NONSENSE-----")
    with pytest.raises(UserError, match="cannot be read: expected"):
        Credentials.read(folder)


def test_an_expired_one(tmp_path):
    make_certificates(tmp_path / "c", (), 0)
    with pytest.raises(UserError, match="expired on 20"):
        Credentials.read(tmp_path / "c" / "camera")


def test_one_of_another_ca_and_a_bundle_of_several(certs, other_certs, tmp_path):
    folder = shutil.copytree(certs / "camera", tmp_path / "camera")
    theirs, ours = ((each / "ca" / "ca.pem").read_bytes() for each in (other_certs, certs))
    (folder / "ca.pem").write_bytes(theirs)
    with pytest.raises(UserError, match=r"the CA in ca\.pem did not issue"):
        Credentials.read(folder)
    make_certificates(tmp_path / "old", (), 0)
    for first in (theirs, (tmp_path / "old" / "ca" / "ca.pem").read_bytes()):
        (folder / "ca.pem").write_bytes(first + ours)
        assert (
            Credentials.read(folder).validity.ends
            == Credentials.read(certs / "camera").validity.ends
        )
    (folder / "cert.pem").write_bytes((certs / "camera" / "cert.pem").read_bytes() + theirs)
    assert Credentials.read(folder).name == "camera"


def test_each_end_wants_its_own(certs, tmp_path):
    with pytest.raises(UserError, match="certificate of 'camera': expected the router's"):
        open_run_router(ServeOptions(security=str(certs / "camera")), tmp_path)
    with pytest.raises(UserError, match="'router': expected that of camera or viewer or operator"):
        client_settings(_TLS, str(certs / "router"))
    with pytest.raises(UserError, match="expected an endpoint tls/"):
        client_settings("tcp/127.0.0.1:7447", str(certs / "camera"))
    with pytest.raises(UserError, match="expected --security DIR"):
        client_settings(_TLS, "")
    assert client_settings("tcp/127.0.0.1:7447", "") == {}
