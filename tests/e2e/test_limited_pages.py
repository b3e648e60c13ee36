"""A key that is limited to locations opens the pages and the viewer, and shows those locations there."""

import httpx

from tests.e2e.test_keys import make_key
from tests.support.server import StartServer

GRID = {"kind": "grid2d", "interval_s": 60, "grid": {"resolution_m": 1.0, "shape": [2, 2]}}
WAIT_S = 30.0


def test_a_limited_key_sees_its_locations_on_every_page(server: StartServer) -> None:
    running = server()
    where = ("--data", str(running.data))
    admin = make_key(where, "admin")["key"]
    limited = make_key(where, "operator", "--location", "hall")["key"]
    with httpx.Client(base_url=running.url, trust_env=False, timeout=WAIT_S) as browser:
        for name in ("hall", "yard"):
            headers = {"Authorization": f"Bearer {admin}"}
            assert browser.post("/api/v1/locations", json={"name": name, **GRID}, headers=headers).status_code == 201
        assert browser.post("/login", data={"key": limited}).status_code == 303
        for path in ("/", "/fragments/locations"):
            shown = browser.get(path)
            assert shown.status_code == 200
            assert "/locations/hall" in shown.text
            assert "yard" not in shown.text
        for path in ("/locations/{}", "/fragments/locations/{}", "/fragments/locations/{}/anomalies"):
            assert browser.get(path.format("hall")).status_code == 200
            refused = browser.get(path.format("yard"))
            assert refused.status_code == 403
            assert "limited to other locations" in refused.text
        assert browser.get("/view/").status_code == 200
        assert browser.get("/view/sessions").json() == []
