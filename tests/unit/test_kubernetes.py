"""The manifests for Kubernetes are held to its schemas, to one another and to the project."""

from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from tests.support.commands import refusal
from tests.support.paths import ROOT
from tidemap.cli import parser
from tidemap.settings import Settings

FOLDER = ROOT / "docker" / "kubernetes"
VERSIONS = ("1.30", "1.37")
"""The oldest that is supported, and the newest that there is a schema of."""
NAME = "app.kubernetes.io/name"


def documents(path: Path) -> list[dict[str, Any]]:
    """The resources of a file."""
    return [document for document in yaml.safe_load_all(path.read_text()) if document]


KUSTOMIZATION = documents(FOLDER / "kustomization.yaml")[0]
RESOURCES = [each for name in KUSTOMIZATION["resources"] for each in documents(FOLDER / name)]
COMMAND = documents(FOLDER / "command.yaml")[0]
PODS = {
    each["metadata"]["name"]: each["spec"]["template"]
    for each in [*RESOURCES, COMMAND]
    if "template" in each.get("spec", {})
}
CONTAINERS = [(name, each) for name, pod in PODS.items() for each in pod["spec"]["containers"]]
OURS = [(name, each) for name, each in CONTAINERS if each["image"] == "tidemap"]


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(
    "resource", [*RESOURCES, COMMAND], ids=lambda each: f"{each['kind']} {each['metadata']['name']}"
)
def test_each_is_what_its_schema_says(resource: dict[str, Any], version: str) -> None:
    assert kubernetes_validate.validate(resource, version, strict=True).startswith(version)


def test_a_wrong_field_is_found() -> None:
    wrong = {**RESOURCES[0], "spec": {"replica": 1}}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, VERSIONS[-1], strict=True)


def test_the_kustomization_names_every_file() -> None:
    beside = {path.name for path in FOLDER.glob("*.yaml")} - {"kustomization.yaml", "command.yaml"}
    assert set(KUSTOMIZATION["resources"]) == beside
    (image,) = KUSTOMIZATION["images"]
    assert {image["name"], "postgres:17"} == {each["image"] for _, each in CONTAINERS}


@pytest.mark.parametrize(("name", "container"), OURS, ids=[name for name, _ in OURS])
def test_each_of_our_containers_runs_a_command_that_exists_with_settings_that_exist(
    name: str, container: dict[str, Any]
) -> None:
    if "args" in container:
        assert not refusal(parser(), container["args"])
    for variable in (each["name"] for each in container.get("env", [])):
        assert variable == "PGPASSWORD" or variable.removeprefix("TIDEMAP_").lower() in Settings.model_fields
    security = container["securityContext"]
    assert security["readOnlyRootFilesystem"]
    assert not security["allowPrivilegeEscalation"]
    assert PODS[name]["spec"]["securityContext"]["runAsNonRoot"]
    mounted = {each["name"] for each in container["volumeMounts"]}
    assert mounted == {each["name"] for each in PODS[name]["spec"]["volumes"]}


def test_the_settings_of_all_are_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    (generator,) = KUSTOMIZATION["configMapGenerator"]
    for literal in generator["literals"]:
        variable, value = literal.split("=", 1)
        monkeypatch.setenv(variable, value)
        assert variable.removeprefix("TIDEMAP_").lower() in Settings.model_fields
    settings = Settings()
    services = {each["metadata"]["name"]: each["spec"] for each in RESOURCES if each["kind"] == "Service"}
    scheduler, port = (settings.dask_scheduler or "").removeprefix("tcp://").split(":")
    assert services[scheduler]["ports"][0]["port"] == int(port)
    assert "@database/" in settings.url
    assert "database" in services
    secrets = next(each for each in PODS["server"]["spec"]["volumes"] if each["name"] == "secrets")
    assert settings.secret_path.name == secrets["secret"]["items"][0]["path"]


def test_every_selector_finds_a_pod() -> None:
    names = {pod["metadata"]["labels"][NAME] for pod in PODS.values()}
    for each in RESOURCES:
        selector = each.get("spec", {}).get("selector", {})
        labels = selector.get("matchLabels", selector) if each["kind"] != "NetworkPolicy" else {}
        assert set(labels.values()) <= names, each["metadata"]["name"]
        if each["kind"] == "HorizontalPodAutoscaler":
            assert each["spec"]["scaleTargetRef"]["name"] in names
        if each["kind"] == "NetworkPolicy":
            pods = each["spec"]["podSelector"]
            chosen = pods.get("matchLabels", {}).get(NAME) or pods["matchExpressions"][0]["values"]
            assert {chosen} <= names if isinstance(chosen, str) else set(chosen) <= names


def test_probes_ask_for_what_is_served() -> None:
    (_, server) = next(each for each in OURS if each[0] == "server")
    paths = {server[probe]["httpGet"]["path"] for probe in ("startupProbe", "livenessProbe", "readinessProbe")}
    assert paths == {"/healthz", "/readyz"}
    assert server["ports"][0]["containerPort"] == Settings.model_fields["port"].default
