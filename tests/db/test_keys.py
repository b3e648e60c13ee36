"""Keys: only a hash of the secret is ever stored."""

import hashlib

import pytest
from sqlalchemy import select

from tidemap.errors import KeyNotFoundError, UnauthorizedError
from tidemap.services.context import Context
from tidemap.services.keys import by_secret, by_session, create_key, delete_key, list_keys, session_of
from tidemap.storage.tables import api_key


def test_no_row_holds_the_secret(ctx: Context) -> None:
    key = create_key(ctx, "lab robot", "robot")
    with ctx.store.read() as work:
        (row,) = work.keys._connection.execute(select(api_key)).mappings()
    assert bytes(row["hash"]) == hashlib.sha256(key.key.encode()).digest()
    shown = [str(value) for name, value in row.items() if name != "hash"]
    assert not any(key.key[8:] in value for value in shown)
    assert row["prefix"] == key.key[:8]
    assert key.key not in list_keys(ctx)[0].model_dump_json()


def test_a_secret_opens_until_it_is_revoked(ctx: Context) -> None:
    robot, admin = create_key(ctx, "robot", "robot"), create_key(ctx, "boss", "admin")
    assert robot.key != admin.key
    principal = by_secret(ctx, robot.key)
    assert (principal.name, principal.role, principal.key_id) == ("robot", "robot", robot.id)
    delete_key(ctx, robot.id)
    with pytest.raises(UnauthorizedError):
        by_secret(ctx, robot.key)
    with pytest.raises(KeyNotFoundError):
        delete_key(ctx, robot.id)
    assert [key.name for key in list_keys(ctx)] == ["boss"]


@pytest.mark.parametrize("secret", ["", "tm_", "tm_nobody", "\0", "ü" * 10_000])
def test_another_secret_does_not_open(ctx: Context, secret: str) -> None:
    create_key(ctx, "robot", "robot")
    with pytest.raises(UnauthorizedError):
        by_secret(ctx, secret)


def test_a_session_ends_with_its_time_and_with_its_key(ctx: Context) -> None:
    key = create_key(ctx, "ann", "operator")
    token = session_of(ctx, key.key)
    assert by_session(ctx, token).name == "ann"
    assert key.key not in token
    number, expires, signature = token.split(".")
    for forged in (
        f"{number}.{int(expires) + 1}.{signature}",
        f"{int(number) + 1}.{expires}.{signature}",
        f"{number}.{expires}.{'0' * len(signature)}",
        f"{number}.{expires}",
        f"{number}.{expires}.ü",
        "",
        "9" * 500 + f".{expires}.{signature}",
    ):
        with pytest.raises(UnauthorizedError):
            by_session(ctx, forged)
    ctx.clock.now = float(expires) + 1  # type: ignore[attr-defined]
    with pytest.raises(UnauthorizedError):
        by_session(ctx, token)
    ctx.clock.now -= 10  # type: ignore[attr-defined]
    delete_key(ctx, key.id)
    with pytest.raises(UnauthorizedError):
        by_session(ctx, token)
