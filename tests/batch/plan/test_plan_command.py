"""`hsslam-batch plan` checks everything that can be checked before the first run."""

import errno
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_batch.attempt.serve_log import serve_command
from hsslam_batch.plan.batch import MANIFEST, UnavailableError
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.lock import alone
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_bench.batch.small_log import write_small_log
from hsslam_node.device.choose_device import choose_device
from hsslam_node.errors import UserError
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.run.config_file import CONFIG_FILE, config_text
from hsslam_services.run.options import ServeOptions


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Two logs of two frames."""
    for k in range(2):
        write_small_log(tmp_path / "logs" / f"log{k}", start=10 * k, count=2)
    return tmp_path / "logs"


def _plan(logs: Path, out: Path, *options: str):
    plan_command([str(logs), "--out", str(out), *options])
    return read_batch(str(out))


def test_manifest_and_options_are_written(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    batch = _plan(logs, tmp_path / "out", "--preset", "eslam", "--seed", "3", "--frames", "1")
    assert "2 logs, " in (said := capsys.readouterr().out) and "2 frames" in said
    planned = read_manifest(batch.out)
    assert [(log.index, log.name, log.frames) for log in planned] == [
        (0, "log0", 1),
        (1, "log1", 1),
    ]
    options = parse_command_line(["--config", str(batch.config)])
    assert (options.preset, options.seed, options.pace) == ("eslam", 3, "lockstep")
    assert options.viewer == "none"


def test_a_mask_that_cannot_be_read_is_named_and_the_plan_stays(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), np.full((8, 8), 255, np.uint8))
    _plan(logs, tmp_path / "out", "--mask", str(mask))
    before = read_manifest(tmp_path / "out")
    write_small_log(logs / "log2", count=2)
    opened = Path.open

    def open_others(path: Path, *args, **kwargs):
        if path == mask:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return opened(path, *args, **kwargs)

    monkeypatch.setattr(Path, "open", open_others)
    with pytest.raises(UserError, match=rf"{mask}: Permission denied: expected a mask or map that"):
        _plan(logs, tmp_path / "out", "--mask", str(mask))
    assert read_manifest(tmp_path / "out") == before


@pytest.mark.parametrize(("given", "device"), [([], "auto"), (["--device", "cuda"], "cuda")])
def test_a_run_takes_a_gpu_only_if_the_plan_names_one(
    logs: Path, tmp_path: Path, given: list[str], device: str
):
    batch = _plan(logs, tmp_path / "out", *given)
    _, _, _, _, *arguments = serve_command(batch, read_manifest(batch.out)[0], tmp_path / "run")
    options = parse_command_line(arguments)
    assert (options.pace, options.device) == ("lockstep", device)
    if device == "auto":
        assert choose_device(device, reproducible=True).kind == "cpu"


def test_the_hash_follows_the_options_and_not_the_folder(logs: Path, tmp_path: Path):
    first = _plan(logs, tmp_path / "a")
    assert _plan(logs, tmp_path / "b") == type(first)(tmp_path / "b", first.about)
    assert _plan(logs, tmp_path / "a", "--seed", "0").about == first.about
    assert _plan(logs, tmp_path / "a", "--seed", "1").about.configuration != (
        first.about.configuration
    )


def test_a_batch_that_runs_keeps_its_plan(logs: Path, tmp_path: Path):
    batch = _plan(logs, tmp_path / "out")
    before = {path: path.read_bytes() for path in batch.out.iterdir()}
    with (
        alone(batch.out, batch.place),
        pytest.raises(UserError, match=r"out: another hsslam-batch run or plan uses it: expected"),
    ):
        _plan(logs / "log1", batch.out, "--seed", "1")
    assert before == {path: path.read_bytes() for path in batch.out.iterdir()}


def test_results_of_the_batch_are_no_logs_whatever_path_leads_to_them(logs: Path, tmp_path: Path):
    write_small_log(logs / "out" / "runs" / "id0", count=1)
    (tmp_path / "link").symlink_to(logs)
    for root, out in ((logs, logs / "out"), (logs, "link/out"), ("link", logs / "out")):
        batch = _plan(tmp_path / root, tmp_path / out)
        assert [log.name for log in read_manifest(batch.out)] == ["log0", "log1"]
    plan_command([logs.as_uri(), "--out", str(tmp_path / "link/out")])
    assert read_manifest(batch.out)[0].place == str(logs / "log0")


def test_out_is_refused_if_its_results_would_be_logs_of_the_next_plan(logs: Path, tmp_path: Path):
    refused = r"^--out .*: its results would be among the logs of .*: expected another folder$"
    (tmp_path / "link").symlink_to(logs)
    for root, out in ((logs, logs), (logs, "link"), ("link", logs), ("link/runs/id0", logs)):
        with pytest.raises(UserError, match=refused):
            _plan(tmp_path / root, tmp_path / out)
    for root in ("s3://bucket/out/", "s3://bucket/out/runs"):
        with pytest.raises(UserError, match=refused):
            plan_command([root, "--out", "s3://bucket/out"])
    assert not (logs / "batch.json").exists()
    batch = _plan(logs, tmp_path)  # beside the results
    assert [log.name for log in read_manifest(batch.out)] == ["log0", "log1"]


def test_a_link_to_a_log_that_is_not_there_is_left_out_with_a_warning(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (logs / "log2.mcap").symlink_to("/unmounted/log2.mcap")
    batch = _plan(logs, tmp_path / "out")
    assert [log.name for log in read_manifest(batch.out)] == ["log0", "log1"]
    link = logs / "log2.mcap"
    assert capsys.readouterr().err == (
        f"warning: {link}: left out: a link to /unmounted/log2.mcap, which is not there\n"
    )


def test_a_log_whose_path_is_not_utf8_is_left_out_with_a_warning(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    strange = os.fsdecode(b"log\xff")
    (logs / "log1").rename(logs / strange)
    batch = _plan(logs, tmp_path / "out")
    assert [log.name for log in read_manifest(batch.out)] == ["log0"]
    said = capsys.readouterr()
    warning = f"warning: {str(logs / strange)!r}: left out: expected a path in UTF-8\n"
    assert said.err == warning and "1 logs, " in said.out
    for root, out in ((logs / strange, tmp_path / "other"), (logs, tmp_path / strange)):
        with pytest.raises(UserError, match=r"log\\udcff': is not UTF-8: expected a path in UTF-8"):
            _plan(root, out)
        assert not out.exists()


def test_a_value_that_is_not_utf8_is_one_line_and_changes_no_plan(logs: Path, tmp_path: Path):
    batch = _plan(logs, tmp_path / "out")
    before = {path.name: path.read_bytes() for path in batch.out.iterdir() if path.is_file()}
    mask = tmp_path / os.fsdecode(b"mask\xff.png")
    cv2.imwrite(str(tmp_path / "mask.png"), np.full((6, 8), 255, np.uint8))
    (tmp_path / "mask.png").rename(mask)
    with pytest.raises(UserError, match=r"mask\\udcff.*is not UTF-8: expected a value in UTF-8"):
        _plan(logs, batch.out, "--mask", str(mask))
    after = {path.name: path.read_bytes() for path in batch.out.iterdir() if path.is_file()}
    assert after == before


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--sed", "1"], "--sed: unknown option; did you mean --seed"),
        (["--seed", "x"], "--seed x: expected a whole number"),
        (["--preset", "reeltime"], "--preset reeltime: expected"),
        (["--source", "tum:fr1/desk"], "--source tum:fr1/desk: expected no such option"),
        (["--source", "synth:room"], "--source synth:room: expected no such option"),
        (["--source=synth:room"], "--source synth:room: expected no such option"),
        (["--metrics-port", "9000"], "--metrics-port 9000: expected no such option"),
        (["--pace", "realtime"], "--pace realtime: expected lockstep"),
        (["--viewer", "web"], "--viewer web: expected none"),
    ],
)
def test_a_wrong_option_ends_the_plan(logs: Path, tmp_path: Path, options: list[str], line: str):
    with pytest.raises(UserError, match=line):
        _plan(logs, tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()


def test_the_options_of_a_run_serve_but_for_those_that_each_run_decides(logs: Path, tmp_path: Path):
    run = ServeOptions(
        source="ros2:",
        seed=3,
        downscale=2,
        viewer="web",
        zenoh_port=7448,
        bind="0.0.0.0",
        security="certs",
        metrics_port=9000,
        ros2_out="/hsslam",
    )
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / CONFIG_FILE).write_text(config_text(run))
    batch = _plan(logs, tmp_path / "a", "--config", str(tmp_path / "run"))
    options = parse_command_line(["--config", str(batch.config)])
    usual = ServeOptions(config=options.config, slam=options.slam)
    assert options == replace(usual, seed=3, downscale=2, pace="lockstep", viewer="none")
    with pytest.raises(UserError, match=r"^--metrics-port 9000: expected no such option"):
        _plan(logs, tmp_path / "a", "--config", str(tmp_path / "run"), "--metrics-port", "9000")


def test_a_mask_is_found_from_any_folder_and_looked_for_at_once(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=r"--mask mask.png: no such file or folder: expected"):
        _plan(logs, tmp_path / "out", "--mask", "mask.png")
    assert not (tmp_path / "out").exists()
    (tmp_path / "mask.png").write_bytes(b"")
    batch = _plan(logs, tmp_path / "out", "--mask", "mask.png")
    options = parse_command_line(["--config", str(batch.config)])
    assert options.mask == str(tmp_path / "mask.png")


@pytest.mark.parametrize("named", ["room.safetensors", "./maps/desk.safetensors", "desk"])
def test_a_map_is_found_from_any_folder_and_looked_for_at_once(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=rf"^--map {named}: no such "):
        _plan(logs, tmp_path / "out", "--map", named)
    assert not (tmp_path / "out").exists()
    saved = tmp_path / (named if "." in named else "maps/desk.safetensors")
    saved.parent.mkdir(exist_ok=True)
    saved.touch()
    batch = _plan(logs, tmp_path / "out", "--map", named)
    assert parse_command_line(["--config", str(batch.config)]).map == str(saved)


def test_folders_that_are_none(tmp_path: Path):
    with pytest.raises(UserError, match="expected LOGS --out OUT"):
        plan_command([str(tmp_path)])
    with pytest.raises(UserError, match=r"^file://there/out: expected a folder as file:///FOLDER"):
        plan_command([str(tmp_path), "--out", "file://there/out"])
    with pytest.raises(UserError, match=r"^ftq://a: .*expected a URL as s3://"):
        read_batch("ftq://a")
    with pytest.raises(
        UserError, match=r"batch.json: No such file .*: expected a folder of hsslam"
    ):
        read_batch(str(tmp_path))
    (tmp_path / "manifest.parquet").write_bytes(b"no table")
    with pytest.raises(UserError, match="expected a file of hsslam-batch plan"):
        read_manifest(tmp_path)
    with pytest.raises(UserError, match=r"nowhere: no manifest.parquet"):
        read_manifest(tmp_path / "nowhere")


def test_a_damaged_manifest_is_bad_input_and_one_that_the_disk_does_not_give_is_not(
    logs: Path, tmp_path: Path
):
    """A link to itself stands for a disk that fails: both give an error of the system."""
    batch = _plan(logs, tmp_path / "out")
    path = batch.out / MANIFEST
    content = bytearray(path.read_bytes())
    content[-60:-8] = 52 * b"\xff"  # the description of the columns
    path.write_bytes(content)
    with pytest.raises(UserError, match="expected a file of hsslam-batch plan") as damaged:
        read_manifest(batch.out)
    assert not isinstance(damaged.value, UnavailableError)
    path.unlink()
    with pytest.raises(UserError, match="expected a folder of hsslam-batch plan"):
        read_manifest(batch.out)
    path.symlink_to(path)  # too many levels
    with pytest.raises(UnavailableError, match="expected a disk that can be read"):
        read_manifest(batch.out)
