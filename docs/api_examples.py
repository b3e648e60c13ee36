"""The examples of answers in the API's document, asked of a real site: `python -m docs.api_examples`."""

import json
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import tidemap.api
from tests.api.house import NOW, Api, fortnight, open_house
from tests.support.scans import files
from tests.support.waiting import until
from tidemap.services.keys import delete_key

FILE = Path(tidemap.api.__path__[0]) / "answer_examples.json"
LONGEST = 4
"""Items that a list of an example has at most."""
DOOR = {"name": "office-door", "interval_s": 3600, "time_zone": "Europe/London", "confidence": 0.75}
LAB_GRID = {"frame": "map", "origin": [0.0, 0.0, 0.0], "resolution_m": 0.5, "shape": [4, 3, 2]}
LAB = {"name": "lab", "kind": "grid3d", "interval_s": 3600, "grid": LAB_GRID}
SCAN = {"time": NOW, "map_from_sensor": [1, 1, 0.5, 0, 0, 0, 1], "covariance": np.eye(6).tolist()}
MUTE = {
    "locations": ["office-*"],
    "start": NOW + 10 * 3600,
    "stop": NOW + 12 * 3600,
    "weekly": True,
    "note": "Cleaning.",
}
SECRET = re.compile(r"(tm_|whsec_)[A-Za-z0-9_+/=-]+")


def main() -> None:
    """Write the file."""
    with TemporaryDirectory() as folder, open_house(Path(folder)) as api:
        found = {name: shortened(answer) for name, answer in ask(api).items()}
    text = json.dumps(found, indent=1, sort_keys=True, ensure_ascii=False)
    FILE.write_text(SECRET.sub(r"\1…", text) + "\n")


def ask(api: Api) -> dict[str, Any]:
    """One answer of each operation that answers in JSON, by its id."""
    time, state = fortnight()
    here = "/locations/office-door"
    said = {
        "create_location": api.post("/locations", DOOR).json(),
        "post_observations": api.observe("office-door", time, state),
        "update_location": api.post(f"{here}/update?wait=60", {"estimator": "fft", "order": 2}).json(),
    }
    api.post("/locations", LAB)
    api.post("/locations/lab/observations", {"observations": [{"time": NOW - 3600, "occupied": [0], "free": [1]}]})
    api.update("lab")
    webhook = api.post("/webhooks", {"url": "https://alarms.example.org/tidemap"}).json()
    seen = api.observe("office-door", [NOW + 1800], [1])
    event = seen["anomalies"][0]["id"]
    scan = api.post("/locations/lab/scans", files=files(SCAN, np.ones((60, 3), np.float32))).json()
    delivery = until(lambda: api.get(f"/webhooks/{webhook['id']}/deliveries").json()["items"])[0]["id"]
    span = {"start": NOW - 7 * 86400, "stop": NOW}
    said |= {
        "post_observations": seen,
        "post_scan": scan,
        "create_webhook": webhook,
        "list_scans": api.get("/locations/lab/scans").json(),
        "replay_scan": api.post(f"/locations/lab/scans/{scan['scan']}/replay").json(),
        "get_location": api.get(here).json(),
        "list_locations": api.get("/locations").json(),
        "change_location": api.patch(here, {"confidence": 0.8}).json(),
        "get_state": api.get(f"{here}/state?time={NOW + 9 * 3600:.0f}").json(),
        "predict": api.post(f"{here}/predict", {"time": [NOW + 9 * 3600]}).json(),
        "get_series": api.get(f"{here}/series?start={NOW - 86400:.0f}&stop={NOW:.0f}").json(),
        "get_density": api.get(f"{here}/density?bins=4").json(),
        "get_information": api.get(f"{here}/information?start={NOW:.0f}&stop={NOW + 86400:.0f}&best=2").json(),
        "get_model": api.get(f"{here}/model").json(),
        "evaluate": api.post(f"{here}/evaluate", {**span, "orders": [1, 2]}).json(),
        "find_confidence": api.get(f"{here}/confidence").json(),
        "list_anomalies": api.get("/anomalies").json(),
        "list_location_anomalies": api.get(f"{here}/anomalies").json(),
        "detect_anomalies": api.post(f"{here}/anomalies/detect", {**span, "confidence": 0.5}).json(),
        "get_anomaly": api.get(f"/anomalies/{event}").json(),
        "acknowledge_anomaly": api.post(f"/anomalies/{event}/acknowledge", {"note": "A late delivery."}).json(),
        "snooze_anomaly": api.post(f"/anomalies/{event}/snooze", {"until": NOW + 6 * 3600}).json(),
        "create_mute": api.post("/mutes", MUTE).json(),
        "list_mutes": api.get("/mutes").json(),
        "list_jobs": api.get("/jobs").json(),
        "get_job": api.get(f"/jobs/{said['update_location']['id']}").json(),
        "list_webhooks": api.get("/webhooks").json(),
        "get_webhook": api.get(f"/webhooks/{webhook['id']}").json(),
        "change_webhook": api.patch(f"/webhooks/{webhook['id']}", {"description": "The night watch."}).json(),
        "test_webhook": api.post(f"/webhooks/{webhook['id']}/test").json(),
        "retry_delivery": api.post(f"/webhooks/{webhook['id']}/deliveries/{delivery}/retry").json(),
        "cancel_job": {**said["update_location"], "state": "cancelled", "progress": 0.0, "result": None},
        "list_deliveries": api.get(f"/webhooks/{webhook['id']}/deliveries").json(),
        "delete_observations": api.request(
            "DELETE", f"{here}/observations", params={"start": NOW, "stop": NOW + 3600}
        ).json(),
    }
    return said | of_keys(api)


def of_keys(api: Api) -> dict[str, Any]:
    """Those that need a key from the first one on, which goes at the end."""
    said = {"create_key": api.post("/keys", {"name": "night watch", "role": "admin"}).json()}
    api.http.sign_in(said["create_key"]["key"])
    said |= {
        "rotate_key": api.post(f"/keys/{said['create_key']['id']}/rotate").json(),
        "list_keys": api.get("/keys").json(),
        "list_audit_log": api.get("/audit").json(),
    }
    for each in (said["create_key"], said["rotate_key"]):
        delete_key(api.ctx, each["id"])
    return said


def shortened(value: Any) -> Any:
    """The same with few items in every list."""
    if isinstance(value, dict):
        return {name: shortened(item) for name, item in value.items()}
    return [shortened(item) for item in value[:LONGEST]] if isinstance(value, list) else value


if __name__ == "__main__":
    main()
