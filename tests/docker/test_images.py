"""What can be known of images and compose file without Docker."""

import json
import re
import shlex
import tomllib

import pytest
import yaml

from hsslam_services.commands.serve_command_line import parse_command_line
from tests.repository import ROOT

_DOCKER = ROOT / "docker"
_FILES = ("Dockerfile", "Dockerfile.cuda")


def _instructions(file: str) -> list[tuple[str, str]]:
    text = (_DOCKER / file).read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(line.split()[0], line.partition(" ")[2]) for line in lines]


def _compose() -> dict:
    return yaml.safe_load((_DOCKER / "compose.yaml").read_text())


@pytest.mark.parametrize("file", _FILES)
def test_an_image_compiles_kernels_and_runs_as_a_user(file):
    instructions = _instructions(file)
    values = dict(instructions)
    assert values["USER"] == "hsslam"  # the last one counts
    assert ("RUN", "hsslam-serve warm-up") in instructions
    assert json.loads(values["ENTRYPOINT"]) == ["hsslam-serve"]
    assert parse_command_line(json.loads(values["CMD"])).source == "synth:room"
    assert any("install.py --venv venv --ros2 " in value for _, value in instructions)
    names = [name for name, _ in instructions]
    assert names.index("USER") < names.index("COPY")  # what is copied belongs to the user
    for name, value in instructions:
        if name == "COPY":
            *sources, _ = [word for word in value.split() if not word.startswith("--")]
            assert all((ROOT / source).exists() for source in sources)
        for used in re.findall(r"source/([\w./]+)", value):
            assert (ROOT / used).is_file()


def test_the_base_image_is_one_and_pinned_by_its_digest():
    bases = {value for file in _FILES for name, value in _instructions(file) if name == "ARG"}
    (base,) = bases
    assert re.fullmatch(r"PYTHON=python:3\.11\.\d+-slim-\w+@sha256:[0-9a-f]{64}", base)
    assert all(("FROM", "${PYTHON}") in _instructions(file) for file in _FILES)


@pytest.mark.parametrize("file", _FILES)
def test_the_example_in_an_image_s_head_is_a_command_line_of_ours(file):
    text = (_DOCKER / file).read_text()
    (line,) = re.findall(r"^#\s+(docker run .*)$", text, re.MULTILINE)
    words = shlex.split(line)
    image = {"Dockerfile": "hsslam", "Dockerfile.cuda": "hsslam-cuda"}[file]
    assert parse_command_line(words[words.index(image) + 1 :]).source == "synth:room"


@pytest.mark.parametrize("name", ["hsslam", "hsslam-cuda", "robot"])
def test_a_service_has_what_it_needs(name):
    compose = _compose()
    service = compose["services"][name]
    options = parse_command_line(service["command"])
    assert (_DOCKER / service["build"]["context"]).resolve() == ROOT
    assert (ROOT / service["build"]["dockerfile"]).is_file()
    assert service["shm_size"] == "2gb"
    assert service["ulimits"] == {"memlock": -1}
    test = service["healthcheck"]["test"]
    assert f"127.0.0.1:{options.metrics_port}/healthz" in test[-1]
    compile(test[-1], "healthcheck", "exec")
    mounted = {volume.split(":")[1]: volume.split(":")[0] for volume in service["volumes"]}
    assert set(mounted.values()) == set(compose["volumes"])
    made = next(v for i, v in _instructions("Dockerfile") if i == "RUN" and v.startswith("mkdir"))
    assert set(mounted) == {f"/home/hsslam/{folder}" for folder in made.split()[1:]}


def test_options_for_a_service_open_the_port_of_its_health_check():
    text = (ROOT / "docs/containers.md").read_text()
    (line,) = re.findall(r"^docker compose \S+ \S+ run -v .*$", text, re.MULTILINE)
    words = shlex.split(line)
    assert parse_command_line(words[words.index("hsslam") + 1 :]).metrics_port == 9100


def test_kernels_of_the_gpu_are_kept_where_the_service_may_write():
    place = "/home/hsslam/.cache"
    volumes = _compose()["services"]["hsslam-cuda"]["volumes"]
    assert place in {volume.split(":")[1] for volume in volumes}
    for file in (_DOCKER / "Dockerfile.cuda", ROOT / "docs/containers.md"):
        assert f" -v hsslam-cache:{place} hsslam-cuda " in file.read_text()


def test_the_image_of_a_batch_has_the_extra_and_takes_any_command():
    instructions = _instructions("Dockerfile.batch")
    values = dict(instructions)
    assert values["USER"] == "hsslam"  # the last one counts
    assert json.loads(values["ENTRYPOINT"]) == []
    assert json.loads(values["CMD"])[0] == "hsslam-batch"
    assert "wget" in next(value for name, value in instructions if name == "RUN")
    lock, _ = values["COPY"].split()[1:]
    asked = shlex.split(values["RUN"].split(" && ")[0])
    assert {"--require-hashes", "--no-deps"} <= set(asked)  # the lock has all
    assert asked[asked.index("--requirement") + 1] == lock.rpartition("/")[2]
    locked = (ROOT / lock).read_text()
    pinned = {_name(pin) for pin in re.findall(r"^[\w.-]+==", locked, re.MULTILINE)}
    base = (ROOT / "requirements/base.lock").read_text()
    in_base = {_name(pin) for pin in re.findall(r"^[\w.-]+==", base, re.MULTILINE)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = {_name(wish) for wish in project["optional-dependencies"]["batch"]}
    assert wanted | {"s3fs", "aiohttp"} <= pinned | in_base  # aiohttp: of Ray's dashboard
    assert len(re.findall("--hash=", locked)) >= len(pinned)


def _name(requirement: str) -> str:
    return re.split(r"[\[=<>]", requirement)[0]


def test_only_what_is_behind_certificates_has_a_port():
    for name, service in _compose()["services"].items():
        options = parse_command_line(service["command"])
        is_open = options.bind == "0.0.0.0"
        assert is_open == bool(options.security) == ("ports" in service), name
        if is_open:
            assert service["ports"] == ["7447:7447"] and options.outside_place == "0.0.0.0:7447"


def test_commands_of_the_page_are_ours():
    text = (ROOT / "docs/containers.md").read_text()
    found = re.findall(r"^ *docker .*\brun .* (?:hsslam|hsslam-cuda) (.+)$", text, re.MULTILINE)
    sources = [
        parse_command_line(words).source
        for words in map(shlex.split, found)
        if words[0] != "rescue"
    ]
    assert {"synth:room", "record:my_recording", "ros2:/camera"} == set(sources)


def test_secrets_and_results_stay_out_of_the_image():
    ignored = (ROOT / ".dockerignore").read_text().split()
    assert {".git", ".venv", "certs", "runs", "maps", "data"} <= set(ignored)
