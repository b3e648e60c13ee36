"""The container files are held to the project: what they copy, run, set and publish exists and agrees."""

import json
import re
import tomllib
from fnmatch import fnmatch
from typing import Any

import pytest
import yaml

from tests.support.commands import refusal
from tests.support.documents import code_lines
from tests.support.paths import ROOT
from tests.support.server import READY_S
from tidemap.cli import parser
from tidemap.settings import Settings

Instruction = tuple[str, str]


@pytest.fixture(scope="module")
def stages() -> list[list[Instruction]]:
    """The Dockerfile as instructions (name, arguments), a list a stage."""
    text = (ROOT / "docker" / "Dockerfile").read_text()
    lines = re.sub(r"^\s*#.*\n", "", text, flags=re.MULTILINE).replace("\\\n", " ").splitlines()
    instructions = [(line.split(None, 1)[0], " ".join(line.split()[1:])) for line in lines if line.strip()]
    starts = [at for at, (name, _) in enumerate(instructions) if name == "FROM"]
    return [instructions[at:end] for at, end in zip(starts, [*starts[1:], None], strict=True)]


@pytest.fixture(scope="module")
def final(stages: list[list[Instruction]]) -> dict[str, str]:
    """The last stage: the arguments of each instruction, the last of its name."""
    return dict(stages[-1])


@pytest.fixture(scope="module")
def image_env(final: dict[str, str]) -> dict[str, str]:
    """The variables that the image sets."""
    return dict(pair.split("=", 1) for pair in final["ENV"].split())


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    """compose.yaml."""
    loaded: dict[str, Any] = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())
    return loaded


def test_what_is_copied_exists_and_is_not_ignored(stages: list[list[Instruction]]) -> None:
    for name, arguments in stages[0]:
        if name == "COPY":
            for source in arguments.split()[:-1]:
                assert (ROOT / source).exists(), source
                assert not _ignored(source), source


def test_the_context_holds_nothing_else() -> None:
    for path in (".git", ".venv", "data", "docs", "tests", "docker", "Makefile"):
        assert _ignored(path), path


def test_everything_that_the_wheel_is_built_of_is_copied(stages: list[list[Instruction]]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {project["project"]["readme"], *project["project"]["license-files"]}
    needed |= {folder.split("/")[0] for folder in wheel["only-include"]}
    copied = {word for name, arguments in stages[0] if name == "COPY" for word in arguments.split()}
    assert needed | {"pyproject.toml", "constraints.txt"} <= copied


def test_it_does_not_run_as_root(final: dict[str, str]) -> None:
    assert int(final["USER"]) > 0
    created = next(arguments for name, arguments in final.items() if name == "RUN")
    assert f"--uid {final['USER']}" in created


def test_the_command_exists(final: dict[str, str]) -> None:
    assert json.loads(final["ENTRYPOINT"]) == ["tidemap"]
    command = json.loads(final["CMD"])
    assert not refusal(parser(), command)
    assert parser().parse_args(command).host == "0.0.0.0"


def test_the_commands_of_the_instructions_exist() -> None:
    in_container = re.compile(r"docker (?:compose run --rm server|run .*? tidemap) ([a-z].*)")
    shown = [found[1] for line in code_lines(ROOT / "docker" / "README.md") if (found := in_container.match(line))]
    assert len(shown) == 5
    for command in shown:
        assert not refusal(parser(), command.split()), command


def test_settings_are_known(image_env: dict[str, str], compose: dict[str, Any]) -> None:
    variables = [*image_env, *compose["services"]["server"]["environment"]]
    settings = [variable for variable in variables if variable.startswith("TIDEMAP_")]
    assert settings
    for variable in settings:
        assert variable.removeprefix("TIDEMAP_").lower() in Settings.model_fields, variable


def test_ports_and_folders_agree(
    final: dict[str, str], image_env: dict[str, str], compose: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable, value in image_env.items():
        if variable.startswith("TIDEMAP_"):
            monkeypatch.setenv(variable, value)
    settings = Settings()
    server = compose["services"]["server"]
    assert final["EXPOSE"] == str(settings.port)
    assert all(published.endswith(f":{settings.port}") for published in server["ports"])
    assert final["VOLUME"] == str(settings.data)
    assert [volume.split(":")[1] for volume in server["volumes"]] == [str(settings.data)]
    assert "/readyz" in final["HEALTHCHECK"]


def test_settings_of_the_user_reach_the_server(compose: dict[str, Any]) -> None:
    (file,) = compose["services"]["server"]["env_file"]
    assert file == {"path": "tidemap.env", "required": False}
    assert file["path"] in (ROOT / "docker" / ".gitignore").read_text().split(), "it may hold a secret"


def test_a_first_start_has_the_time_to_compile(final: dict[str, str], compose: dict[str, Any]) -> None:
    given = re.search(r"--start-period=(\d+)s", final["HEALTHCHECK"])
    assert given is not None
    assert int(given[1]) > READY_S
    assert compose["services"]["server"]["healthcheck"]["start_period"] == f"{given[1]}s"


def test_the_health_check_is_python_that_compiles(final: dict[str, str]) -> None:
    command = json.loads(final["HEALTHCHECK"].split("CMD ", 1)[1])
    assert command[:2] == ["python", "-c"]
    compile(command[2], "HEALTHCHECK", "exec")


def test_compose_has_no_default_password_and_names_its_volumes(compose: dict[str, Any]) -> None:
    for service in compose["services"].values():
        for variable, value in service.get("environment", {}).items():
            if "PASSWORD" in variable:
                assert re.match(r"\$\{POSTGRES_PASSWORD:\?.+}$", value), variable
        for volume in service.get("volumes", []):
            assert volume.split(":")[0] in compose["volumes"]


def test_the_server_waits_for_a_healthy_database(compose: dict[str, Any]) -> None:
    server, database = compose["services"]["server"], compose["services"]["database"]
    assert server["depends_on"]["database"]["condition"] == "service_healthy"
    assert database["healthcheck"]["test"][0] == "CMD"
    assert server["build"] == {"context": "..", "dockerfile": "docker/Dockerfile"}
    url = server["environment"]["TIDEMAP_DATABASE_URL"]
    user, name = database["environment"]["POSTGRES_USER"], database["environment"]["POSTGRES_DB"]
    assert url == f"postgresql+psycopg://{user}@database/{name}"


def _ignored(path: str) -> bool:
    """Whether .dockerignore keeps a path out of the build: the last line that matches decides."""
    ignored = False
    for line in (ROOT / ".dockerignore").read_text().split():
        pattern = line.removeprefix("!")
        if fnmatch(path, pattern) or fnmatch(path.split("/", maxsplit=1)[0], pattern):
            ignored = not line.startswith("!")
    return ignored
