"""Whatever the API's document allows, and what it does not, is answered as that says and never by a 5xx.

What is refused stores nothing.
"""

from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from schemathesis import Case, GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.core.parameters import ParameterLocation
from schemathesis.core.result import Ok
from schemathesis.schemas import APIOperation, BaseSchema
from schemathesis.specs.openapi import checks

from tests.api.house import Api, done, open_house
from tests.api.refusals import T, Untouched, furnished
from tests.support.scans import files
from tidemap.api.addresses import BASE
from tidemap.api.main import ROUTERS
from tidemap.scope import EVERYWHERE
from tidemap.services.keys import create_key
from tidemap.services.webhooks import create_webhook, delete_webhook, list_webhooks

EXAMPLES = 30
"""Requests to each operation in each mode."""
STEADY = settings(
    max_examples=EXAMPLES,
    derandomize=True,
    deadline=None,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
"""The same requests in every run. They are told as they came: the site is another after each of them."""
CHECKS = [
    not_a_server_error,
    checks.status_code_conformance,
    checks.content_type_conformance,
    checks.response_headers_conformance,
    checks.response_schema_conformance,
    checks.negative_data_rejection,
    checks.missing_required_header,
]
OPERATIONS = sorted(
    (BASE + route.path, method) for router in ROUTERS for route in router.routes for method in route.methods
)
MODES = {"allowed": GenerationMode.POSITIVE, "not-allowed": GenerationMode.NEGATIVE}
ENDLESS = {(f"{BASE}/events", "GET")}
"""Tested with a real server, in tests/e2e/test_server_sent.py: an answer without end has none to look at here."""
ALL_ALLOWED = {(f"{BASE}/locations/{{name}}", "GET"), (f"{BASE}/locations/{{name}}", "DELETE")}
"""These take a name only, and every text may be one."""
NEVER_IN_TIME = {
    (f"{BASE}/jobs/{{job_id}}", "DELETE"),
    (f"{BASE}/locations/{{name}}/evaluate", "POST"),
    (f"{BASE}/locations/{{name}}/scans", "POST"),
    (f"{BASE}/webhooks", "POST"),
    (f"{BASE}/webhooks/{{webhook_id}}/deliveries/{{delivery_id}}/retry", "POST"),
}
"""Jobs that have ended cannot be cancelled; no scan is found by chance, for a pose has a norm, nor a URL that can be
sent to; an evaluation is found seldom, for it needs a candidate and a time in which something was seen."""


class Guest:
    """Sends requests to a site where every id and name may be real."""

    def __init__(self, api: Api, site: Untouched) -> None:
        self.api, self.site = api, site
        own = create_key(api.ctx, "own", "admin")
        api.http.sign_in(own.key)
        self.own_key = own.id
        self.changed = True
        self.schema: BaseSchema = schemathesis.openapi.from_dict(as_lists(done(api.get("/openapi.json"))))

    def operation(self, path: str, method: str) -> APIOperation[Any, Any, Any, Any]:
        return self.schema[path][method]

    def real(self, case: Case[Any], location: str, number: int) -> None:
        """Name things that exist, each in its turn, where the path is not what is wrong with the request."""
        for name in case.path_parameters:
            if case.meta is not None and case.meta.is_negative_at(ParameterLocation.PATH):
                continue
            case.path_parameters[name] = (
                self._location(case, location) if name == "name" else self._number(name, number)
            )
        self._accept()

    def _accept(self) -> None:
        """Let what was made since the last request stay; it is looked at once, for that takes longer than asking."""
        if self.changed:
            self.site.accept()
        self.changed = False

    def _location(self, case: Case[Any], location: str) -> str:
        """One of its own for what changes a location for good."""
        if case.method not in ("PATCH", "DELETE") or "scan_id" in case.path_parameters:
            return location
        self.changed = True
        return self.api.location()

    def _number(self, name: str, number: int) -> int:
        if name == "scan_id":
            return self._scan()
        if name not in ("key_id", "webhook_id") or number % 2:
            return number
        self.changed = True
        return self._key() if name == "key_id" else self._webhook()

    def _key(self) -> int:
        return create_key(self.api.ctx, "guest", "robot").id

    def _webhook(self) -> int:
        """A new one, for there may be a hundred, that leads nowhere."""
        for each in list_webhooks(self.api.ctx, None, 100):
            delete_webhook(self.api.ctx, each.id)
        return create_webhook(self.api.ctx, "https://localhost/", "", EVERYWHERE).record.id

    def _scan(self) -> int:
        """One in the quarantine of the lab, whose map has too few cells to place it."""
        header = {"time": T, "map_from_sensor": [11, 21, 0.5, 0, 0, 0, 1], "covariance": np.eye(6).tolist()}
        answer = self.api.post("/locations/lab/scans", files=files(header, np.ones((60, 3), np.float32)))
        self.changed = True
        return int(done(answer, 201)["scan"])

    def send(self, case: Case[Any]) -> Any:
        sent = case.as_transport_kwargs(base_url="http://localhost")
        # None where the form has no part.
        if files := sent.pop("files", None):
            parts = [(name, (None, as_bytes(part[1]), *part[2:])) for name, part in files]
            sent.pop("data", None)
            whole = httpx.Request("POST", sent["url"], files=parts)
            sent["data"] = whole.read()
            sent["headers"] = {**sent.get("headers", {}), "Content-Type": whole.headers["Content-Type"]}
        sent["content"] = sent.pop("data", None)
        assert not sent.pop("cookies")
        return self.api.http.request(sent.pop("method"), sent.pop("url"), **sent)

    def settle(self, answer: Any) -> None:
        """Look at what is stored, once what was begun has ended."""
        if answer.status_code == 202:
            done(self.api.get(f"/jobs/{answer.json()['id']}?wait=60"))
        if answer.is_success and answer.request.method != "GET":
            self.changed = True
        else:
            self.site.check()


def as_bytes(content: Any) -> bytes:
    """A part's content, of whatever kind it was made."""
    return content if isinstance(content, bytes) else str(content).encode()


def as_lists(schema: Any) -> Any:
    """A schema with lists of n items for tuples of equal ones: schemathesis stumbles over `prefixItems` in answers."""
    if isinstance(schema, list):
        return [as_lists(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    made = {name: as_lists(value) for name, value in schema.items()}
    if (items := made.pop("prefixItems", None)) is not None:
        assert all(each == items[0] for each in items)
        made["items"] = items[0]
    return made


@pytest.fixture(scope="module")
def guest(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guest]:
    with open_house(tmp_path_factory.mktemp("guest"), requests_per_s=0) as api, furnished(api) as site:
        yield Guest(api, site)


def test_every_operation_is_tried(guest: Guest) -> None:
    found = [each.ok() for each in guest.schema.get_all_operations() if isinstance(each, Ok)]
    described = {(each.path, each.method.upper()) for each in found}
    assert {operation for operation in described if operation[0].startswith(BASE)} == set(OPERATIONS) | ENDLESS


@pytest.mark.parametrize(
    ("path", "method", "mode"),
    [(*each, mode) for each in OPERATIONS for mode in MODES if mode == "allowed" or each not in ALL_ALLOWED],
)
def test_requests(guest: Guest, path: str, method: str, mode: str) -> None:
    operation = guest.operation(path, method)
    statuses: set[int] = set()
    locations, numbers = st.sampled_from(["door", "lab"]), st.integers(1, 4)

    @STEADY
    @given(case=operation.as_strategy(generation_mode=MODES[mode]), location=locations, number=numbers)
    def run(case: Case[Any], location: str, number: int) -> None:
        guest.real(case, location, number)
        assume(case.path_parameters.get("key_id") != guest.own_key)
        answer = guest.send(case)
        statuses.add(answer.status_code)
        case.validate_response(answer, checks=CHECKS)
        guest.settle(answer)

    run()
    assert mode != "allowed" or statuses & {200, 201, 202, 204} or (path, method) in NEVER_IN_TIME
