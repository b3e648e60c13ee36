"""The API's own description: OpenAPI 3.1, complete, and true."""

import json
import re
from collections.abc import Iterator
from typing import Any
from urllib.parse import unquote

import jsonschema_rs
import pytest

from tests.api.house import ARROW, BASE, GRID, NOW, NPY, PROBLEM, Api, done, fortnight, problem
from tidemap.api.openapi import OPERATION_IDS
from tidemap.api.problem_examples import SAMPLES
from tidemap.services.keys import delete_key

# What API.md fixes: method, path, the statuses of success.
CONTRACT = {
    ("post", "/locations"): {"201"},
    ("get", "/locations"): {"200"},
    ("get", "/locations/{name}"): {"200"},
    ("patch", "/locations/{name}"): {"200"},
    ("delete", "/locations/{name}"): {"204"},
    ("post", "/locations/{name}/observations"): {"200", "201"},
    ("delete", "/locations/{name}/observations"): {"200"},
    ("post", "/locations/{name}/scans"): {"200", "201"},
    ("get", "/locations/{name}/scans"): {"200"},
    ("get", "/locations/{name}/scans/{}/points"): {"200"},
    ("post", "/locations/{name}/scans/{}/replay"): {"200"},
    ("delete", "/locations/{name}/scans/{}"): {"204"},
    ("post", "/locations/{name}/update"): {"200", "202"},
    ("get", "/jobs"): {"200"},
    ("get", "/jobs/{}"): {"200"},
    ("delete", "/jobs/{}"): {"200"},
    ("get", "/locations/{name}/state"): {"200", "304"},
    ("post", "/locations/{name}/predict"): {"200"},
    ("get", "/locations/{name}/series"): {"200"},
    ("get", "/locations/{name}/density"): {"200", "304"},
    ("get", "/locations/{name}/information"): {"200"},
    ("get", "/locations/{name}/export"): {"200"},
    ("get", "/locations/{name}/model"): {"200"},
    ("post", "/locations/{name}/evaluate"): {"200"},
    ("get", "/locations/{name}/confidence"): {"200"},
    ("get", "/anomalies"): {"200", "304"},
    ("get", "/locations/{name}/anomalies"): {"200", "304"},
    ("post", "/locations/{name}/anomalies/detect"): {"200"},
    ("get", "/anomalies/{}"): {"200"},
    ("post", "/anomalies/{}/acknowledge"): {"200"},
    ("get", "/events"): {"200"},
    ("get", "/keys"): {"200"},
    ("post", "/keys"): {"201"},
    ("post", "/keys/{}/rotate"): {"201"},
    ("delete", "/keys/{}"): {"204"},
    ("get", "/audit"): {"200"},
    ("get", "/webhooks"): {"200"},
    ("post", "/webhooks"): {"201"},
    ("get", "/webhooks/{}"): {"200"},
    ("patch", "/webhooks/{}"): {"200"},
    ("delete", "/webhooks/{}"): {"204"},
    ("post", "/webhooks/{}/test"): {"200"},
    ("get", "/webhooks/{}/deliveries"): {"200"},
    ("post", "/webhooks/{}/deliveries/{}/retry"): {"200"},
}
PARAMETERS = {
    ("get", "/locations"): {"limit", "after"},
    ("post", "/locations/{name}/observations"): {"source", "Idempotency-Key"},
    ("delete", "/locations/{name}/observations"): {"start", "stop", "source"},
    ("post", "/locations/{name}/scans"): {"source", "Idempotency-Key"},
    ("get", "/locations/{name}/scans"): {"registration", "limit", "after"},
    ("post", "/locations/{name}/update"): {"wait"},
    ("get", "/locations/{name}/state"): {"time", "confidence", "order", "estimator", "bbox", "observed"},
    ("get", "/locations/{name}/series"): {"cell", "start", "stop", "step"},
    ("get", "/locations/{name}/density"): {"start", "stop", "bins"},
    ("get", "/locations/{name}/information"): {"time", "start", "stop", "step", "bbox", "best", "as_of", "given"},
    ("get", "/locations/{name}/export"): {
        "format",
        "time",
        "confidence",
        "source",
        "mode",
        "given",
        "z_min",
        "z_max",
    },
    ("get", "/locations/{name}/model"): {"cell", "order"},
    ("get", "/locations/{name}/confidence"): {"false_alarms_per_week", "rule"},
    ("get", "/jobs"): {"limit", "after"},
    ("get", "/jobs/{}"): {"wait"},
    ("get", "/events"): {"location", "kind", "after", "Last-Event-ID"},
    ("get", "/keys"): {"limit", "after"},
    ("get", "/anomalies"): {"after", "limit", "start", "stop", "min_surprise", "acknowledged"},
    ("get", "/locations/{name}/anomalies"): {"after", "limit", "start", "stop", "min_surprise", "acknowledged"},
}
ERRORS = {"401", "403", "422", "429", "503"}
TYPES = {"string", "number", "integer", "boolean", "array", "object", "null"}


@pytest.fixture(scope="module")
def document(api: Api) -> Any:
    return done(api.get("/openapi.json"))


Operation = tuple[str, str, dict[str, Any]]


def operations(document: Any) -> Iterator[Operation]:
    """Method, path under the base, operation."""
    for path, item in document["paths"].items():
        for method, operation in item.items():
            if path.startswith(BASE):
                yield method, path.removeprefix(BASE), operation


def plain(path: str) -> str:
    """A path as the contract writes it: ids have no name."""
    return re.sub(r"\{\w+_id\}", "{}", path)


def resolve(document: Any, reference: str) -> Any:
    found = document
    for part in reference.removeprefix("#/").split("/"):
        found = found[unquote(part).replace("~1", "/").replace("~0", "~")]
    return found


def nodes(value: Any, path: str = "#") -> Iterator[tuple[str, Any]]:
    """Every object of a document with its path."""
    if isinstance(value, dict):
        yield path, value
        for key, item in value.items():
            yield from nodes(item, f"{path}/{key}")
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from nodes(item, f"{path}/{i}")


def test_it_is_openapi_3_1(document: Any) -> None:
    assert re.fullmatch(r"3\.1\.\d+", document["openapi"])
    assert {"title", "version", "description"} <= document["info"].keys()
    assert set(document) <= {"openapi", "info", "servers", "paths", "components", "security", "tags"}
    assert "nullable" not in json.dumps(document), "that is OpenAPI 3.0"


def test_every_route_of_the_contract_is_in_it(document: Any) -> None:
    described = {(method, plain(path)): operation for method, path, operation in operations(document)}
    assert described.keys() >= CONTRACT.keys()
    for route, statuses in CONTRACT.items():
        found = {status for status in described[route]["responses"] if status[0] in "23"}
        assert found == statuses, route
    for route, names in PARAMETERS.items():
        assert {p["name"] for p in described[route].get("parameters", [])} - {"name"} >= names, route
    assert {"/healthz", "/readyz", "/metrics"} <= document["paths"].keys()


def test_every_route_documents_its_errors_as_problems(document: Any) -> None:
    for method, path, operation in operations(document):
        failures = {status: answer for status, answer in operation["responses"].items() if status[0] in "45"}
        assert failures.keys() >= ERRORS, (method, path)
        for status, answer in failures.items():
            assert set(answer["content"]) == {PROBLEM}, (method, path, status)
            media = answer["content"][PROBLEM]
            assert media["schema"] == {"$ref": "#/components/schemas/Problem"}
            for kind, example in media["examples"].items():
                assert example["value"]["status"] == int(status)
                assert example["value"]["type"] == f"urn:tidemap:problem:{kind}"
                assert len(example["value"]["detail"]) > 10
            assert answer["description"]
        assert "WWW-Authenticate" in failures["401"]["headers"]
        assert "Retry-After" in failures["429"]["headers"]
        assert "Retry-After" in failures["503"]["headers"]


def test_every_kind_of_problem_is_shown_somewhere(document: Any) -> None:
    shown = {
        kind
        for _, _, operation in operations(document)
        for answer in operation["responses"].values()
        for kind in answer.get("content", {}).get(PROBLEM, {}).get("examples", {})
    }
    assert shown == SAMPLES.keys()


def test_what_has_an_etag_can_be_asked_with_it(document: Any) -> None:
    for method, path, operation in operations(document):
        is_cached = "304" in operation["responses"]
        names = {each["name"] for each in operation.get("parameters", [])}
        assert ("If-None-Match" in names) == is_cached, (method, path)
        assert ("ETag" in operation["responses"].get("200", {}).get("headers", {})) == is_cached


def test_answers_that_make_something_say_where_it_is(document: Any) -> None:
    for path, status in (("/locations", "201"), ("/locations/{name}/update", "202")):
        assert "Location" in document["paths"][BASE + path]["post"]["responses"][status]["headers"]


def test_names_of_operations_can_be_read(document: Any) -> None:
    for method, path, operation in operations(document):
        assert re.fullmatch(r"[a-z]+(_[a-z]+)*", operation["operationId"]), (method, path)
        assert "api_v" not in operation["operationId"]
    assert OPERATION_IDS.keys() >= {(method, path) for method, path, _ in operations(document)}


def test_the_socket_is_described(document: Any) -> None:
    answer = document["paths"][f"{BASE}/events"]["get"]["responses"]["101"]
    for word in ("1013", "4401", "WebSocket", "Last-Event-ID"):
        assert word in answer["description"]
    assert resolve(document, answer["content"]["application/json"]["schema"]["$ref"])["properties"].keys() == {
        "kind",
        "location",
        "id",
        "time",
    }


def test_every_json_answer_has_an_example_of_its_schema(document: Any) -> None:
    for method, path, operation in operations(document):
        for status, answer in operation["responses"].items():
            media = answer.get("content", {}).get("application/json", {})
            if status[0] == "2" and media:
                assert "example" in media, (method, path, status)
                schema = {**media["schema"], "components": document["components"]}
                jsonschema_rs.validate(schema, media["example"])


def test_every_answer_with_content_has_a_schema(document: Any) -> None:
    for method, path, operation in operations(document):
        for status, answer in operation["responses"].items():
            if status in ("101", "204", "304"):
                assert status == "101" or not answer.get("content"), (method, path, status)
                continue
            for media_type, media in answer["content"].items():
                assert media.get("schema"), (method, path, status, media_type)
    posted = document["paths"][f"{BASE}/locations/{{name}}/observations"]["post"]["requestBody"]["content"]
    assert posted.keys() == {"application/json", ARROW, NPY}
    state = document["paths"][f"{BASE}/locations/{{name}}/state"]["get"]["responses"]["200"]["content"]
    assert state.keys() == {"application/json", ARROW, NPY}


def test_every_operation_is_named_and_explained(document: Any) -> None:
    names = [operation["operationId"] for _, _, operation in operations(document)]
    assert len(names) == len(set(names))
    for method, path, operation in operations(document):
        assert operation["description"].strip(), (method, path)
        assert operation["tags"], (method, path)
        in_path = re.findall(r"\{(\w+)\}", path)
        declared = [p["name"] for p in operation.get("parameters", []) if p["in"] == "path"]
        assert declared == in_path
        for parameter in operation.get("parameters", []):
            assert parameter["in"] in ("path", "query", "header", "cookie")
            assert parameter["schema"]
            assert parameter["required"] is True or parameter["in"] != "path"


def bodies(document: Any) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Method, path, JSON media type of every route that takes a body."""
    for method, path, operation in operations(document):
        if "requestBody" in operation:
            yield method, path, operation["requestBody"]["content"]["application/json"]


def examples(document: Any, media: dict[str, Any]) -> list[Any]:
    """The examples of a body: of its media type, or of its form."""
    found = [each["value"] for each in media.get("examples", {}).values()]
    if "example" in media:
        found.append(media["example"])
    choices = media["schema"].get("anyOf", [media["schema"]])
    for choice in choices:
        if "$ref" in choice:
            found += resolve(document, choice["$ref"]).get("examples", [])
    return found


def test_every_body_has_examples(document: Any) -> None:
    found = {(method, path): examples(document, media) for method, path, media in bodies(document)}
    assert len(found) == 15
    assert not [route for route, shown in found.items() if not shown]


def test_every_example_of_a_body_is_accepted(document: Any, api: Api) -> None:
    name = api.location(estimator="fft", order=3, confidence=0.75)
    api.observe(name, *fortnight())
    api.update(name)
    (event,) = api.observe(name, [NOW + 30], [1])["anomalies"]
    grid = api.lab(grid={**GRID, "shape": [60, 40, 12]})
    for method, path, media in bodies(document):
        for example in examples(document, media):
            on_grid = isinstance(example, dict) and {"observations", "ranges"} & example.keys()
            location = grid if on_grid else name
            if path == "/locations/{name}" and method == "patch":
                location = api.location()
            address = path.replace("{name}", location).replace("{anomaly_id}", str(event["id"]))
            if "{key_id}" in path:
                continue  # a key ends what is open here: tests/api/test_limited_keys.py
            if "{webhook_id}" in path:
                made = done(api.post("/webhooks", {"url": "https://alarms.example.org"}), 201)
                address = path.replace("{webhook_id}", str(made["id"]))
            answer = api.request(method.upper(), address, json=example)
            assert answer.status_code in (200, 201, 202), (path, example, answer.text)
            if path == "/keys":
                delete_key(api.ctx, answer.json()["id"])  # or it would lock the next ones out


def test_every_reference_leads_somewhere(document: Any) -> None:
    for where, node in nodes(document):
        if isinstance(node.get("$ref"), str):
            assert resolve(document, node["$ref"]) is not None, where


def test_every_schema_is_json_schema(document: Any) -> None:
    for where, node in nodes(document["components"]["schemas"], "#/components/schemas"):
        kind = node.get("type")
        if isinstance(kind, str) and "properties" not in where.split("/")[-1:]:
            assert kind in TYPES, where
        for name in ("anyOf", "oneOf", "allOf", "prefixItems", "enum", "required"):
            if name in node and not where.endswith("/properties"):
                assert isinstance(node[name], list), where
        if isinstance(node.get("properties"), dict) and isinstance(node.get("required"), list):
            assert set(node["required"]) <= node["properties"].keys(), where


def test_every_form_refuses_unknown_fields(document: Any) -> None:
    for _, path, media in bodies(document):
        for choice in media["schema"].get("anyOf", [media["schema"]]):
            if "$ref" in choice:
                schema = resolve(document, choice["$ref"])
                assert schema["additionalProperties"] is False, path


def test_every_route_refuses_unknown_parameters_and_names_those_described(document: Any, api: Api) -> None:
    for method, path, operation in operations(document):
        address = re.sub(r"\{\w+\}", "1", path)
        answer = api.request(method.upper(), address, params={"limit": 5, "nothing_such": 1, "Time": 2})
        errors = {each["field"]: each["message"] for each in problem(answer, 422, "invalid-input")["errors"]}
        known = [each["name"] for each in operation.get("parameters", []) if each["in"] == "query"]
        assert errors.keys() == {"nothing_such", "Time", "limit"} - set(known), (method, path)
        assert errors["Time"].endswith(f"known are {', '.join(known)}" if known else "none is known here")


def test_no_schema_is_left_unused(document: Any) -> None:
    used = {node["$ref"] for _, node in nodes(document) if isinstance(node.get("$ref"), str)}
    assert {f"#/components/schemas/{name}" for name in document["components"]["schemas"]} == used


def test_keys_are_described(document: Any) -> None:
    assert document["components"]["securitySchemes"]["key"]["scheme"] == "bearer"
    assert {"key": []} in document["security"]
