"""`hsslam-certs`: what it makes, and what it refuses."""

import datetime
import shutil
import socket
from pathlib import Path

import pytest
from cryptography import x509

from hsslam_services.commands.certs import main

_FOLDERS = ("ca", "camera", "operator", "router", "viewer")


def test_keys_are_for_their_owner_alone_and_certificates_say_what_they_are_for(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    folder = Path("[red]")
    main([str(folder), "--host", "10.0.0.7", "robot.local", "--days", "3"])
    told = capsys.readouterr().out
    assert "10.0.0.7" in told and "[red]/camera" in told
    assert tuple(sorted(path.name for path in folder.iterdir())) == _FOLDERS
    ca = x509.load_pem_x509_certificate((folder / "ca" / "ca.pem").read_bytes())
    keys = set()
    for name in _FOLDERS:
        assert (folder / name).stat().st_mode & 0o777 == 0o700
        key = folder / name / "key.pem"
        assert key.stat().st_mode & 0o777 == 0o600
        keys.add(key.read_bytes())
        if name != "ca":
            certificate = x509.load_pem_x509_certificate((folder / name / "cert.pem").read_bytes())
            certificate.verify_directly_issued_by(ca)
            names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
            is_router = name == "router"
            assert ("robot.local" in names.value.get_values_for_type(x509.DNSName)) == is_router
            assert bool(names.value.get_values_for_type(x509.IPAddress)) == is_router
            longer = ca.not_valid_after_utc - certificate.not_valid_after_utc
            assert round(longer / datetime.timedelta(days=3), 3) == 9  # the CA: ten times as long
    assert len(keys) == len(_FOLDERS)


def test_a_name_of_this_machine_that_is_no_host_name_is_left_out(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(socket, "gethostname", lambda: "küche_1")
    main([str(tmp_path / "certs"), "--host", "robot.local"])
    assert "known as localhost, 127.0.0.1, ::1, robot.local\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("", "no folder: expected hsslam-certs DIR"),
        ("x --days 0", "--days 0: expected 1 to 3650"),
        ("x --host a_b", "--host a_b: expected names or addresses"),
        ("x --host 10.0.0.7:7447", "--host 10.0.0.7:7447: expected names or addresses, without"),
        ("x --host a..b", "--host a..b: expected names or addresses"),
        ("x --hots a", "--hots: unknown option; did you mean --host?"),
    ],
)
def test_a_mistake_is_one_line(line, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    assert ended.value.code == 2
    assert expected in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_nothing_is_overwritten(tmp_path, capsys):
    main([str(tmp_path / "certs")])
    before = (tmp_path / "certs" / "ca" / "key.pem").read_bytes()
    with pytest.raises(SystemExit):
        main([str(tmp_path / "certs")])
    assert "is not empty: expected a new folder" in capsys.readouterr().err
    assert (tmp_path / "certs" / "ca" / "key.pem").read_bytes() == before


def test_a_ca_that_is_there_issues_the_next_certificates(certs, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    before = (certs / "ca" / "key.pem").read_bytes()
    main(["next", "--days", "7", "--ca", str(certs / "ca")])
    told = capsys.readouterr().out
    assert "next/camera" in told and "keep it safe" not in told
    assert {path.name for path in Path("next").iterdir()} == {*_FOLDERS} - {"ca"}
    for folder in Path("next").iterdir():
        key = folder / "key.pem"
        assert key.stat().st_mode & 0o777 == 0o600
        assert key.read_bytes() != (certs / folder.name / "key.pem").read_bytes()
        assert (folder / "ca.pem").read_bytes() == (certs / "ca" / "ca.pem").read_bytes()
    assert (certs / "ca" / "key.pem").read_bytes() == before


@pytest.mark.parametrize(
    ("spoil", "days", "expected"),
    [
        (lambda ca: (ca / "ca.pem").unlink(), "7", "ca.pem: No such file or directory: expected"),
        (lambda ca: (ca / "key.pem").unlink(), "7", "key.pem: No such file or directory: expected"),
        (lambda ca: (ca / "ca.pem").write_text("x"), "7", "cannot be read: expected ca.pem"),
        (lambda ca: shutil.copy(ca.parent / "key.pem", ca), "7", "key.pem is not the key of ca"),
        (lambda _: None, "71", "or later, for --days 71; without --ca a new CA is made"),
    ],
)
def test_a_ca_that_cannot_issue_them_is_refused_in_one_line(
    certs, tmp_path, capsys, spoil, days, expected
):
    ca = shutil.copytree(certs / "ca", tmp_path / "ca")
    shutil.copy(certs / "camera" / "key.pem", tmp_path)
    spoil(ca)
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path / "next"), "--days", days, "--ca", str(ca)])
    told = capsys.readouterr().err
    assert ended.value.code == 2 and told.count("\n") == 1
    assert f"--ca {ca}: " in told and expected in told
    assert not (tmp_path / "next").exists()
