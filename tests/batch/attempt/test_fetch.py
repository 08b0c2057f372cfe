"""Logs come out of an object store whole, in spite of its faults, and only as they were planned."""

import dataclasses
import io
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer

from hsslam_batch.attempt import fetch
from hsslam_batch.attempt.fetch import fetch_log, fetched_place
from hsslam_batch.plan import tried
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.find_logs import find_logs, on_this_machine
from hsslam_batch.plan.log import Log, read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_batch.plan.remote_listing import list_url
from hsslam_node.errors import UserError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.replica import ReplicaFolder, ReplicaSource
from tests.batch.object_store import BUCKET, Faults, faulty, object_store, reach

_LOGS = f"s3://{BUCKET}/logs"
_OBJECTS = {
    "logs/loose.mcap": bytes(range(256)) * 1000,
    "logs/day/walk/run.mcap": b"first part" * 1000,
    "logs/day/walk/run.1.mcap": b"second part" * 1000,
    "logs/day/walk/mesh.ply": b"no part of the log",
    "logs/desk/rgb.txt": b"# colour",
    "logs/desk/depth.txt": b"# depth",
    "logs/desk/rgb/1.png": b"an image",
    "logs/.trash/run.mcap": b"hidden",
    "logs/notes.txt": b"no log",
}


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[str, Any]]:
    """An object store with logs."""
    with object_store() as (url, client):
        for name, content in _OBJECTS.items():
            client.put_object(Bucket=BUCKET, Key=name, Body=content)
        yield url, client


@pytest.fixture
def store(server, monkeypatch: pytest.MonkeyPatch):
    """Its client, and a function that sets the address where logs are looked for."""

    def look_at(url: str) -> None:
        reach(url, monkeypatch)

    look_at(server[0])
    return server[1], look_at, server[0]


def _logs() -> dict[str, Log]:
    return {log.name: log for log in find_logs(list_url(_LOGS))}


def test_logs_in_a_store_are_found_as_in_a_folder(store):
    found = _logs()
    assert {name: log.kind for name, log in found.items()} == {
        "day/walk": "mcap",
        "desk": "tum",
        "loose.mcap": "mcap",
    }
    assert found["desk"].place == f"{_LOGS}/desk" and found["day/walk"].nbytes == 21_000
    (alone,) = find_logs(list_url(f"{_LOGS}/loose.mcap"))
    assert (alone.place, alone.nbytes) == (f"{_LOGS}/loose.mcap", 256_000)
    with pytest.raises(UserError, match="nothing: no files below"):
        list_url(f"s3://{BUCKET}/nothing")
    with pytest.raises(UserError, match=r"^ftq://a: .*expected a URL as s3://"):
        list_url("ftq://a")


def test_results_of_the_batch_are_no_logs(store, tmp_path: Path, monkeypatch):
    client, _, _ = store
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    out = f"s3://{BUCKET}/fleet/tonight"
    for name in ("day/run.mcap", "tonight/runs/0/1.0/run.mcap", "tonight2/run.mcap"):
        client.put_object(Bucket=BUCKET, Key=f"fleet/{name}", Body=b"a log")
    plan_command([f"s3://{BUCKET}/fleet/", "--out", f"{out}/"])
    names = [log.name for log in read_manifest(read_batch(out).out)]
    assert names == ["day", "tonight2"]
    (only,) = find_logs(list_url(f"{out}/runs", without=out))  # asked for: OUT is above it
    assert only.name == "0/1.0"


def test_a_log_comes_whole_in_spite_of_faults(store, tmp_path: Path, monkeypatch):
    _, look_at, url = store
    found = _logs()
    monkeypatch.setattr(fetch, "_PART_BYTES", 10_000)
    faults = Faults(every=5)
    with faulty(url, faults) as address:
        look_at(address)
        for name in ("loose.mcap", "day/walk", "desk"):
            log = found[name]
            fetch_log(log, tmp_path / log.id, most_gb=1.0)
            place = fetched_place(tmp_path / log.id, log)
            objects = {k: v for k, v in _OBJECTS.items() if k.startswith(f"logs/{name}")}
            objects.pop("logs/day/walk/mesh.ply", None)
            for key, content in objects.items():
                rest = key.removeprefix(f"logs/{name}").lstrip("/")
                assert (place / rest if rest else place).read_bytes() == content
            hidden = [p.name for p in place.rglob("*") if p.name.startswith(".")]
            assert place.is_file() or not hidden
    assert faults.refused > 0 and faults.broken > 0


def test_a_fetched_mcap_file_of_ros_is_a_bag_and_a_log_is_none(store, tmp_path: Path):
    client, _, _ = store
    for name, profile in (("drive", "ros2"), ("walk", "")):
        writer = Writer(stream := io.BytesIO())
        writer.start(profile=profile)
        writer.finish()
        client.put_object(Bucket=BUCKET, Key=f"robot/{name}.mcap", Body=stream.getvalue())
    kinds = {}
    for log in find_logs(list_url(f"s3://{BUCKET}/robot")):
        fetch_log(log, tmp_path / log.id, most_gb=1.0)
        place = str(fetched_place(tmp_path / log.id, log))
        kinds[log.name] = (log.kind, on_this_machine(log, place).source)
    assert kinds["walk.mcap"][1].startswith("mcap:") and kinds["drive.mcap"][0] == "mcap"
    assert kinds["drive.mcap"][1].startswith("bag:/")


def test_two_attempts_at_a_log_fetch_it_one_after_the_other(store, tmp_path: Path):
    log = _logs()["loose.mcap"]
    held = subprocess.Popen(
        ["flock", tmp_path / ".lock", "-c", "echo held; sleep 1"], stdout=subprocess.PIPE
    )
    assert held.stdout is not None
    held.stdout.readline()
    begin_s = time.monotonic()
    fetch_log(log, tmp_path, most_gb=1.0)
    assert time.monotonic() - begin_s > 0.5 and fetched_place(tmp_path, log).is_file()
    held.wait()


def test_the_marker_of_a_folder_is_no_file(store, tmp_path: Path):
    """An object of 0 bytes, which consoles and copy tools make for each folder."""
    client, _, _ = store
    files = {name: data for name, data in _OBJECTS.items() if name.startswith("logs/desk/")}
    before = _logs()["desk"]
    for folder in ("", "desk/", "desk/rgb/"):
        client.put_object(Bucket=BUCKET, Key=f"marked/{folder}", Body=b"")
    for name, content in files.items():
        client.put_object(Bucket=BUCKET, Key=name.replace("logs/", "marked/"), Body=content)
    (log,) = find_logs(list_url(f"s3://{BUCKET}/marked"))
    assert (log.name, log.id) == (before.name, before.id)
    fetch_log(log, tmp_path, most_gb=1.0)
    place = fetched_place(tmp_path, log)
    fetched = {f"logs/desk/{p.relative_to(place)}": p for p in place.rglob("*") if p.is_file()}
    assert {name: path.read_bytes() for name, path in fetched.items()} == files
    client.put_object(Bucket=BUCKET, Key="empty/", Body=b"")
    with pytest.raises(UserError, match="empty: no files below: expected logs"):
        list_url(f"s3://{BUCKET}/empty")


def test_what_lies_beside_a_sequence_comes_with_it(store, tmp_path: Path, replica_folder: Path):
    """The published archive of Replica has one camera for all scenes, and their meshes, beside the scenes."""
    client, _, _ = store
    files = {
        path: f"room0/{path.relative_to(replica_folder)}" for path in replica_folder.rglob("*.*")
    }
    files[replica_folder / "cam_params.json"] = "cam_params.json"
    for path, name in files.items():
        client.upload_file(str(path), BUCKET, f"archive/{name}")
    for name in ("room0_mesh.ply", "scene1.sens", "scene1_vh_clean.ply"):
        client.put_object(Bucket=BUCKET, Key=f"archive/{name}", Body=name.encode())
    room, scene = find_logs(list_url(f"s3://{BUCKET}/archive"))
    for log in (room, scene):
        fetch_log(log, tmp_path / log.id, most_gb=1.0)
    place = fetched_place(tmp_path / room.id, room)
    assert ReplicaSource(str(place), SourceOptions()).frame_count == 4  # it needs the camera
    assert ReplicaFolder(place).mesh_file == place.with_name("room0_mesh.ply")
    mesh = fetched_place(tmp_path / scene.id, scene).with_name("scene1_vh_clean.ply")
    assert mesh.read_text() == mesh.name


def test_files_beside_a_log_come_anew_for_each_attempt(store, tmp_path: Path):
    """They may change without a new plan, also to another file of the same size, and go."""
    client, _, _ = store
    mesh = "scene2_vh_clean.ply"
    for name, content in (("scene2.sens", b"a log"), (mesh, b"an old mesh")):
        client.put_object(Bucket=BUCKET, Key=f"scenes/{name}", Body=content)
    (log,) = find_logs(list_url(f"s3://{BUCKET}/scenes"))
    fetch_log(log, tmp_path, most_gb=1.0)
    assert (tmp_path / mesh).read_bytes() == b"an old mesh"
    client.put_object(Bucket=BUCKET, Key=f"scenes/{mesh}", Body=b"a new mesh.")
    (tmp_path / f".{mesh}.partial").write_bytes(b"an old")
    fetch_log(log, tmp_path, most_gb=1.0)
    assert (tmp_path / mesh).read_bytes() == b"a new mesh."
    client.delete_object(Bucket=BUCKET, Key=f"scenes/{mesh}")
    fetch_log(log, tmp_path, most_gb=1.0)
    assert not (tmp_path / mesh).exists()


def test_a_part_that_is_longer_than_its_file_is_fetched_anew(store, tmp_path: Path):
    log = _logs()["loose.mcap"]
    (tmp_path / ".loose.mcap.partial").write_bytes(bytes(300_000))
    fetch_log(log, tmp_path, most_gb=1.0)
    assert fetched_place(tmp_path, log).read_bytes() == _OBJECTS["logs/loose.mcap"]


def test_a_fetch_goes_on_where_it_ended(store, tmp_path: Path, monkeypatch):
    _, look_at, url = store
    log = _logs()["loose.mcap"]
    monkeypatch.setattr(fetch, "_PART_BYTES", 100_000)
    (tmp_path / ".loose.mcap.partial").write_bytes(_OBJECTS["logs/loose.mcap"][:150_000])
    faults = Faults(every=1000)
    with faulty(url, faults) as address:
        look_at(address)
        fetch_log(log, tmp_path, most_gb=1.0)
    assert fetched_place(tmp_path, log).read_bytes() == _OBJECTS["logs/loose.mcap"]
    assert [asked for _, asked in faults.ranges] == ["bytes=150000-249999", "bytes=250000-255999"]


def test_a_log_that_changes_while_it_is_fetched_is_bad_input(store, tmp_path: Path, monkeypatch):
    """Its size stays, so that all parts come; they are of two versions."""
    client, look_at, url = store
    client.put_object(Bucket=BUCKET, Key="growing/walk.mcap", Body=b"a" * 30_000)
    (log,) = find_logs(list_url(f"s3://{BUCKET}/growing"))
    monkeypatch.setattr(fetch, "_PART_BYTES", 10_000)

    class Changing(Faults):
        def next(self) -> str:
            if len(self.ranges) == 1:
                client.put_object(Bucket=BUCKET, Key="growing/walk.mcap", Body=b"b" * 30_000)
            return super().next()

    with faulty(url, changing := Changing(every=1000)) as address:
        look_at(address)
        with pytest.raises(UserError, match=r"walk\.mcap: has changed since the plan"):
            fetch_log(log, tmp_path, most_gb=1.0)
    assert len(changing.ranges) == 3


def test_what_is_not_as_planned_or_too_large_is_one_line(store, tmp_path: Path):
    client, _, _ = store
    log = _logs()["loose.mcap"]
    with pytest.raises(UserError, match=r"loose.mcap: 0.00 GB: expected at most 0.0001"):
        fetch_log(log, tmp_path, most_gb=0.0001)
    huge = dataclasses.replace(log, nbytes=log.nbytes + 1)
    with pytest.raises(UserError, match="has changed since the plan"):
        fetch_log(huge, tmp_path, most_gb=1.0)
    client.put_object(Bucket=BUCKET, Key="logs/loose.mcap", Body=bytes(256_000))
    with pytest.raises(UserError, match="has changed since the plan"):
        fetch_log(log, tmp_path, most_gb=1.0)


def test_a_store_that_does_not_answer_is_an_error_after_some_tries(
    store, tmp_path: Path, monkeypatch
):
    _, look_at, url = store
    log = _logs()["day/walk"]
    monkeypatch.setattr(tried, "_TRIES", 1)
    with faulty(url, Faults(every=1)) as address:
        look_at(address)
        with pytest.raises(OSError, match=r"day/walk/run.*\.mcap: "):
            fetch_log(log, tmp_path, most_gb=1.0)


def test_what_passes_is_no_bad_input(store, tmp_path: Path, monkeypatch):
    """A store that lists nothing now: the log is tried again."""
    _, look_at, _ = store
    log = _logs()["loose.mcap"]
    monkeypatch.setattr(tried, "_TRIES", 1)
    look_at("http://127.0.0.1:1")
    with pytest.raises(OSError, match=r"^s3://.*loose\.mcap: "):
        fetch_log(log, tmp_path, most_gb=1.0)
    with pytest.raises(UserError, match=r"^s3://.*: expected a URL that can be read"):
        list_url(log.place)  # of a plan, whose user is there
