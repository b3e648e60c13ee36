"""Who has a copy of the database has no key and no session: nothing that can be made of it is let in."""

import hashlib
import hmac
from base64 import b64encode, urlsafe_b64encode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy

from tests.api.house import NOW, Api, done, open_house, problem
from tidemap.services.keys import SESSION_S, start_session
from tidemap.storage.tables import api_key, session

COOKIE = "tidemap_session"


@pytest.fixture
def keyed(tmp_path: Path, database_url: str) -> Iterator[tuple[Api, str]]:
    """A site with an admin's key, and its secret."""
    with open_house(tmp_path, database_url) as api:
        yield api, done(api.post("/keys", {"name": "the admin", "role": "admin"}), 201)["key"]


def copied(database_url: str, table: sqlalchemy.Table) -> list[dict[str, Any]]:
    """All rows of a table, as somebody reads them who has a copy of the database."""
    engine = sqlalchemy.create_engine(database_url)
    try:
        with engine.connect() as connection:
            return [dict(row) for row in connection.execute(sqlalchemy.select(table)).mappings()]
    finally:
        engine.dispose()


def spellings(stored: bytes) -> list[str]:
    """A stored value as text, in all common ways."""
    return [
        stored.hex(),
        stored.hex().upper(),
        b64encode(stored).decode(),
        urlsafe_b64encode(stored).decode().rstrip("="),
        stored.decode("latin-1"),
        hashlib.sha256(stored).hexdigest(),
    ]


def old_cookie(key_id: int, stored: bytes, expires_at: int) -> str:
    """The cookie of earlier versions: signed with what is stored of a key."""
    signed = f"{key_id}.{expires_at}"
    return f"{signed}.{hmac.new(stored, signed.encode(), hashlib.sha256).hexdigest()}"


def refused(api: Api, text: str) -> None:
    """Neither as a cookie nor as a key does a text let its sender in."""
    cookie = f"{COOKIE}={text}".encode("latin-1")
    for header in ({"Cookie": cookie}, {"Authorization": b"Bearer " + text.encode("latin-1")}):
        problem(api.get("/keys", headers=header), 401, "unauthorized")
        form = {"name": "mine", "role": "admin"}
        problem(api.post("/keys", form, headers=header), 401, "unauthorized")
        assert api.http.request("GET", "/", headers=header).status_code == 303


def test_a_cookie_signed_with_the_stored_hash_is_refused(keyed: tuple[Api, str], database_url: str) -> None:
    api, _ = keyed
    (row,) = copied(database_url, api_key)
    for expires_at in (int(NOW + SESSION_S), int(NOW + 10 * 365 * 86400)):
        refused(api, old_cookie(row["id"], row["hash"], expires_at))


def test_what_is_stored_of_a_key_or_session_is_neither(keyed: tuple[Api, str], database_url: str) -> None:
    api, secret = keyed
    token = start_session(api.ctx, secret)
    (key,), (browser,) = copied(database_url, api_key), copied(database_url, session)
    for text in [*spellings(key["hash"]), *spellings(browser["hash"]), key["prefix"], str(key["id"])]:
        refused(api, text)
        refused(api, f"tm_{text}")
    done(api.get("/keys", headers={"Cookie": f"{COOKIE}={token}"}))
    done(api.get("/keys", headers={"Authorization": f"Bearer {secret}"}))


def test_a_key_is_no_session_and_a_session_no_key(keyed: tuple[Api, str]) -> None:
    api, secret = keyed
    token = start_session(api.ctx, secret)
    problem(api.get("/keys", headers={"Cookie": f"{COOKIE}={secret}"}), 401, "unauthorized")
    problem(api.get("/keys", headers={"Authorization": f"Bearer {token}"}), 401, "unauthorized")


def test_a_session_ends_by_itself(keyed: tuple[Api, str]) -> None:
    api, secret = keyed
    cookie = {"Cookie": f"{COOKIE}={start_session(api.ctx, secret)}"}
    api.clock.now = NOW + SESSION_S - 1
    done(api.get("/keys", headers=cookie))
    api.clock.now = NOW + SESSION_S
    problem(api.get("/keys", headers=cookie), 401, "unauthorized")
    assert api.http.request("GET", "/", headers=cookie).status_code == 303
