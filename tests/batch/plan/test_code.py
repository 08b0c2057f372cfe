"""Code and options of a plan: other ones are noticed, and the same code is the same wherever it lies."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hsslam_batch
from hsslam_batch.attempt.commit import commit, settled
from hsslam_batch.plan.batch import OtherPlanError
from hsslam_batch.plan.code import sources_digest
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_bench.batch.small_log import write_small_log
from tests.batch.outcomes import outcome, planned, run_folder
from tests.repository import ROOT


def test_the_digest_follows_the_python_files_and_not_their_place(tmp_path: Path):
    package = tmp_path / "here" / "package"
    (package / "folder").mkdir(parents=True)
    for name in ("one.py", "folder/two.py"):
        (package / name).write_text("x = 1\n")
    before = sources_digest([package])
    (package / "notes.txt").write_text("no code")
    (package / ".#one.py").symlink_to("nowhere")
    copy = shutil.copytree(package, tmp_path / "there" / "package", symlinks=True)
    assert before == sources_digest([package]) == sources_digest([copy])
    (copy / "one.py").write_text("x = 2\n")
    (package / "one.py").rename(package / "three.py")
    assert len({before, sources_digest([package]), sources_digest([copy])}) == 3


def test_results_of_other_code_of_the_same_version_do_not_count(tmp_path: Path):
    batch = planned(tmp_path / "out")
    here = Path(hsslam_batch.__path__[0])
    edited = shutil.copytree(here, tmp_path / "site" / here.name) / "options.py"
    edited.write_text(f"{edited.read_text()}\n# edited\n")
    plan = "import sys, pathlib, tests.batch.outcomes as o; o.planned(pathlib.Path(sys.argv[1]))"
    subprocess.run(
        [sys.executable, "-c", plan, str(batch.out)],
        env=os.environ | {"PYTHONPATH": str(tmp_path / "site")},
        cwd=ROOT,
        check=True,
    )
    other = read_batch(str(batch.out))
    assert other.about.code == batch.about.code
    assert other.about.configuration != batch.about.configuration
    name = re.escape(batch.about.code)
    said = rf"was planned with {name} \({other.about.digest}\), this is {name} \({batch.about.digest}\): exp"
    with pytest.raises(OtherPlanError, match=said):
        other.expect_same_code()


def test_options_that_were_edited_after_the_plan_are_not_those_of_its_hash(tmp_path: Path):
    batch = planned(tmp_path / "out", seed=3)
    batch.expect_same_code()
    text = batch.config.read_text()
    batch.config.write_text(text.replace("seed = 3", "seed = 4"))
    with pytest.raises(OtherPlanError, match=r"config\.toml: has changed since hsslam-batch plan"):
        batch.expect_same_code()
    batch.config.unlink()
    with pytest.raises(OtherPlanError, match=r"config\.toml: No such file"):
        batch.expect_same_code()


@pytest.mark.parametrize("option", ["mask", "map"])
@pytest.mark.parametrize("is_folder", [False, True], ids=["file", "folder"])
def test_results_of_another_mask_or_map_do_not_count(tmp_path: Path, option: str, is_folder: bool):
    """Its path is the same, its content is drawn or made anew."""
    write_small_log(tmp_path / "logs" / "log0", count=1)
    file = tmp_path / "named" / "map.safetensors"
    file.parent.mkdir()
    file.write_bytes(b"before")
    named = file.parent if is_folder else file
    words = [str(tmp_path / "logs"), "--out", str(tmp_path / "out"), f"--{option}", str(named)]
    plan_command(words)
    batch = read_batch(str(tmp_path / "out"))
    (log,) = read_manifest(batch.out)
    commit(batch, outcome(batch, 0, id=log.id), run_folder(batch, 0))
    plan_command(words)
    assert read_batch(batch.place) == batch and settled(batch, log.id)
    batch.expect_same_code()
    os.utime(file, (1, 1))  # as a copy on another machine has another time
    batch.expect_same_code()

    file.write_bytes(b"after!")
    with pytest.raises(
        OtherPlanError, match=r"its mask or map has changed since hsslam-batch plan"
    ):
        batch.expect_same_code()
    plan_command(words)
    other = read_batch(batch.place)
    assert other.about.configuration != batch.about.configuration
    assert settled(other, log.id) is None
    other.expect_same_code()
    file.unlink()
    file.parent.rmdir()
    with pytest.raises(
        OtherPlanError, match="No such file or directory: expected the mask and map"
    ):
        other.expect_same_code()
