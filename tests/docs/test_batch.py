"""The job files of docs/batch.md have the form that their schedulers want."""

import json
import re
import subprocess

import yaml

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


def test_the_array_of_slurm_is_a_script():
    (script,) = _blocks("bash")
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)
    assert "--index" in script


def test_the_image_of_the_jobs_is_that_of_the_dockerfile():
    text = (ROOT / "docs/batch.md").read_text()
    (image,) = re.findall(r"^docker build -f docker/Dockerfile.batch -t (\S+) \.$", text, re.M)
    definition, _ = map(json.loads, _blocks("json"))
    assert definition["containerProperties"]["image"] == image
    assert f"image: {image}\n" in _blocks("yaml")[0]


def test_the_job_of_kuberay_is_whole():
    (text,) = _blocks("yaml")
    job = yaml.safe_load(text)
    cluster = job["spec"]["rayClusterSpec"]
    groups = [cluster["headGroupSpec"], *cluster["workerGroupSpecs"]]
    for group in groups:
        (container,) = group["template"]["spec"]["containers"]
        volumes = {volume["name"] for volume in group["template"]["spec"]["volumes"]}
        assert {mount["name"] for mount in container["volumeMounts"]} == volumes
    assert groups[0]["rayStartParams"] == {"num-cpus": "0"}  # values are text
    assert "hsslam-batch run" in job["spec"]["entrypoint"]
