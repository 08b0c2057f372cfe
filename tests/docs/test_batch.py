"""The job files of docs/batch.md have the form that their schedulers want."""

import json
import re
import shlex
import subprocess
from typing import Any, Literal

import msgspec
import pytest
import yaml
from hera.workflows import models

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
    shell, _, script = files[0]["containerProperties"]["command"]
    assert shell == "sh"
    line = script.replace("$AWS_BATCH_JOB_ARRAY_INDEX", "7").removeprefix("exec ")
    _expect_work(line, most_s=files[0]["timeout"]["attemptDurationSeconds"])


def _expect_work(line: str, most_s: float) -> None:
    """The line is `hsslam-batch work` for log 7, with options that there are; it ends by itself before
    `most_s`, when the scheduler ends it without a row."""
    command, work, *words = shlex.split(line)
    assert (command, work) == ("hsslam-batch", "work")
    options = parse_options(WorkOptions, "hsslam-batch work", words)
    assert options.index == 7
    assert options.timeout_s is not None and 0.9 * most_s < options.timeout_s <= most_s - 120


def test_argo_knows_every_field_of_its_workflow():
    text, _ = _blocks("yaml")
    workflow = yaml.safe_load(text)
    read = models.Workflow.model_validate(workflow)
    assert _unread(workflow, read.model_dump(by_alias=True, mode="json")) == []
    logs, work = workflow["spec"]["templates"]
    assert logs["steps"][0][0]["template"] == work["name"]
    command = [
        part.replace("{{inputs.parameters.index}}", "7") for part in work["container"]["command"]
    ]
    options = parse_options(WorkOptions, "hsslam-batch work", command[2:])
    assert command[:2] == ["hsslam-batch", "work"] and options.index == 7 and options.timeout_s


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
    (line,) = (line for line in script.splitlines() if line.startswith("srun "))
    (limit,) = re.findall(r"--time=(\d+):(\d+):(\d+)", script)
    hours, minutes, seconds = map(int, limit)
    most_s = 3600 * hours + 60 * minutes + seconds
    _expect_work(line.removeprefix("srun ").replace("$SLURM_ARRAY_TASK_ID", "7"), most_s)


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


class _Form(msgspec.Struct, forbid_unknown_fields=True, rename="camel"):
    """The fields of KubeRay that the job uses."""


class _PodSpec(_Form):
    security_context: dict[str, Any]
    containers: list[dict[str, Any]]
    volumes: list[dict[str, Any]]


class _Pod(_Form):
    spec: _PodSpec


class _Group(_Form):
    ray_start_params: dict[str, str]
    template: _Pod


class _Workers(_Group):
    group_name: str
    replicas: int
    min_replicas: int
    max_replicas: int


class _Cluster(_Form):
    head_group_spec: _Group
    worker_group_specs: list[_Workers]


class _JobSpec(_Form):
    entrypoint: str
    shutdown_after_job_finishes: bool
    ray_cluster_spec: _Cluster


class _Job(_Form):
    api_version: Literal["ray.io/v1"]
    kind: Literal["RayJob"]
    metadata: dict[str, Any]
    spec: _JobSpec


def _ray_job(text: str) -> _JobSpec:
    """The job; an error if it has a field that KubeRay or Kubernetes does not know."""
    job = msgspec.convert(yaml.safe_load(text), _Job)
    cluster = job.spec.ray_cluster_spec
    _expect_known(models.ObjectMeta, job.metadata)
    for group in (cluster.head_group_spec, *cluster.worker_group_specs):
        pod = group.template.spec
        _expect_known(models.PodSecurityContext, pod.security_context)
        for container in pod.containers:
            _expect_known(models.Container, container)
        for volume in pod.volumes:
            _expect_known(models.Volume, volume)
    return job.spec


def _expect_known(model: Any, given: dict[str, Any]) -> None:
    read = model.model_validate(given)
    assert _unread(given, read.model_dump(by_alias=True, mode="json")) == []


def test_the_job_of_kuberay_is_whole():
    job = _ray_job(_blocks("yaml")[1])
    groups = [job.ray_cluster_spec.head_group_spec, *job.ray_cluster_spec.worker_group_specs]
    for group in groups:
        pod = group.template.spec
        (container,) = pod.containers
        mounted = {mount["name"] for mount in container["volumeMounts"]}
        assert mounted == {volume["name"] for volume in pod.volumes}
    assert groups[0].ray_start_params == {"num-cpus": "0"}
    assert "hsslam-batch run" in job.entrypoint


def test_a_misspelt_field_of_the_job_of_kuberay_is_found():
    text = _blocks("yaml")[1]
    free = {"num-cpus", "cpu", "memory"}  # names of Ray's options and of resources
    fields = {*re.findall(r"([\w-]+):(?= |$)", text, re.M)} - free
    assert {"entrypoint", "template", "fsGroup", "mountPath", "sizeLimit"} < fields
    for field in fields:
        misspelt = re.sub(rf"\b{field}:(?= |$)", f"{field}X:", text, flags=re.M)
        with pytest.raises((ValueError, AssertionError)):
            _ray_job(misspelt)
