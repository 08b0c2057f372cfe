"""The job files of docs/batch.md have the form that their schedulers want."""

import json
import re
import shlex
import subprocess
from typing import Any

import yaml

from hsslam_batch.options import RunOptions, WorkOptions
from hsslam_services.commands.cli import parse_options
from tests.repository import ROOT


def _blocks(language: str) -> list[str]:
    text = (ROOT / "docs/batch.md").read_text()
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.M | re.S)


def test_aws_accepts_definition_and_job():
    from botocore.session import Session
    from botocore.validate import ParamValidator

    model = Session().get_service_model("batch")
    files = [json.loads(block) for block in _blocks("json")]
    names = ("RegisterJobDefinition", "SubmitJob")
    for name, file in zip(names, files, strict=True):
        report = ParamValidator().validate(file, model.operation_model(name).input_shape)
        assert not report.has_errors(), report.generate_report()
    assert files[1]["jobDefinition"] == files[0]["jobDefinitionName"]


def test_argo_knows_every_field_of_its_workflow():
    from hera.workflows.models import Workflow

    text, _ = _blocks("yaml")
    workflow = yaml.safe_load(text)
    read = Workflow.model_validate(workflow)
    assert _unread(workflow, read.model_dump(by_alias=True, mode="json")) == []
    logs, work = workflow["spec"]["templates"]
    assert logs["steps"][0][0]["template"] == work["name"]
    command = [
        part.replace("{{inputs.parameters.index}}", "7") for part in work["container"]["command"]
    ]
    options = parse_options(WorkOptions, "hsslam-batch work", command[2:])
    assert command[:2] == ["hsslam-batch", "work"] and options.index == 7


def _unread(given: Any, read: Any, path: str = "") -> list[str]:
    """The paths of fields that a reader did not know."""
    if isinstance(given, dict):
        unread = [f"{path}/{key}" for key in given if key not in read]
        return unread + [
            x for k in given if k in read for x in _unread(given[k], read[k], f"{path}/{k}")
        ]
    if isinstance(given, list):
        pairs = enumerate(zip(given, read, strict=True))
        return [x for k, pair in pairs for x in _unread(*pair, f"{path}[{k}]")]
    return []


def test_the_array_of_slurm_is_a_script():
    (script,) = _blocks("bash")
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)
    assert "--index" in script


def test_ray_knows_the_commands_of_a_cluster_by_hand():
    from ray.scripts.scripts import cli

    text = (ROOT / "docs/batch.md").read_text()
    lines = re.findall(r"^(?:ray|hsslam-batch run) .*", text, re.M)
    used = set()
    for _, name, *words in (shlex.split(line, comments=True) for line in lines):
        if name == "run":
            parse_options(RunOptions, "hsslam-batch run", words)
        else:
            cli.commands[name].make_context(name, words)  # it only parses
            used.add(name)
    assert used == {"get-auth-token", "start", "stop"}


def test_the_image_of_the_jobs_is_that_of_the_dockerfile():
    text = (ROOT / "docs/batch.md").read_text()
    (image,) = re.findall(r"^docker build -f docker/Dockerfile.batch -t (\S+) \.$", text, re.M)
    definition, _ = map(json.loads, _blocks("json"))
    assert definition["containerProperties"]["image"] == image
    assert all(f"image: {image}\n" in text for text in _blocks("yaml"))


def test_the_job_of_kuberay_is_whole():
    _, text = _blocks("yaml")
    job = yaml.safe_load(text)
    cluster = job["spec"]["rayClusterSpec"]
    groups = [cluster["headGroupSpec"], *cluster["workerGroupSpecs"]]
    for group in groups:
        (container,) = group["template"]["spec"]["containers"]
        volumes = {volume["name"] for volume in group["template"]["spec"]["volumes"]}
        assert {mount["name"] for mount in container["volumeMounts"]} == volumes
    assert groups[0]["rayStartParams"] == {"num-cpus": "0"}  # values are text
    assert "hsslam-batch run" in job["spec"]["entrypoint"]
