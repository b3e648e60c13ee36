"""Keys: only a hash of the secret is ever stored."""

import hashlib
import hmac
import math

import pytest
from sqlalchemy import select

from tidemap.errors import InvalidInputError, KeyEndsError, KeyNotFoundError, UnauthorizedError
from tidemap.schemas import keys as schemas
from tidemap.services.context import Context
from tidemap.services.keys import (
    MAX_OVERLAP_S,
    SESSION_S,
    by_secret,
    by_session,
    create_key,
    delete_key,
    end_session,
    list_keys,
    rotate_key,
    start_session,
)
from tidemap.storage.repositories.keys import MAX_SESSIONS
from tidemap.storage.tables import api_key, session


def test_no_row_holds_the_secret(ctx: Context) -> None:
    key = create_key(ctx, "lab robot", "robot")
    with ctx.store.read() as work:
        (row,) = work.keys._connection.execute(select(api_key)).mappings()
    assert bytes(row["hash"]) == hashlib.sha256(key.key.encode()).digest()
    shown = [str(value) for name, value in row.items() if name != "hash"]
    assert not any(key.key[8:] in value for value in shown)
    assert row["prefix"] == key.key[:8]
    assert key.key not in repr(list_keys(ctx)[0])


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


@pytest.mark.parametrize("overlap_s", [math.nan, math.inf, -math.inf, -1.0, MAX_OVERLAP_S + 1])
def test_an_overlap_that_is_none_changes_nothing(ctx: Context, overlap_s: float) -> None:
    key = create_key(ctx, "robot", "robot")
    with pytest.raises(InvalidInputError, match="0 to 7776000 seconds"):
        rotate_key(ctx, key.id, overlap_s)
    (kept,) = list_keys(ctx)
    assert kept.expires_at is None


def test_the_overlap_has_one_bound_in_the_form_and_behind_it() -> None:
    assert schemas.MAX_OVERLAP_S == MAX_OVERLAP_S


def test_a_key_that_was_rotated_makes_no_second_one_that_ends_with_it(ctx: Context) -> None:
    key = create_key(ctx, "robot", "robot")
    first = rotate_key(ctx, key.id, 100.0)
    ctx.clock.now += 50  # type: ignore[attr-defined]
    with pytest.raises(KeyEndsError, match="rotate the key that was made then"):
        rotate_key(ctx, key.id, 100.0)
    assert len(list_keys(ctx)) == 2
    assert first.expires_at is None
    assert rotate_key(ctx, first.id, 100.0).expires_at is None


def test_a_session_ends_with_its_time(ctx: Context) -> None:
    token = start_session(ctx, create_key(ctx, "ann", "operator").key)
    assert by_session(ctx, token).name == "ann"
    ctx.clock.now += SESSION_S - 1  # type: ignore[attr-defined]
    assert by_session(ctx, token).name == "ann"
    ctx.clock.now += 1  # type: ignore[attr-defined]
    _expect_refused(ctx, token)


def test_a_session_ends_when_its_browser_signs_out_and_no_other_does(ctx: Context) -> None:
    key = create_key(ctx, "ann", "operator")
    first, second = start_session(ctx, key.key), start_session(ctx, key.key)
    end_session(ctx, first)
    _expect_refused(ctx, first)
    assert by_session(ctx, second).name == "ann"


def test_all_sessions_of_a_key_end_with_it(ctx: Context) -> None:
    gone, stays = create_key(ctx, "ann", "operator"), create_key(ctx, "bob", "operator")
    first, second = start_session(ctx, gone.key), start_session(ctx, stays.key)
    delete_key(ctx, gone.id)
    _expect_refused(ctx, first)
    assert by_session(ctx, second).name == "bob"


def test_a_copy_of_the_database_makes_no_session(ctx: Context) -> None:
    """Signed with a stored hash, as cookies once were, or with what is stored of a session: nothing opens."""
    token = start_session(ctx, create_key(ctx, "boss", "admin").key)
    with ctx.store.read() as work:
        (key,) = work.keys._connection.execute(select(api_key)).mappings()
        (stored,) = work.keys._connection.execute(select(session)).mappings()
    claim = f"{key['id']}.{int(ctx.clock() + 3600)}"
    signature = hmac.new(key["hash"], claim.encode(), hashlib.sha256).hexdigest()
    for forged in (f"{claim}.{signature}", stored["hash"].hex(), stored["hash"].decode("latin-1"), key["hash"].hex()):
        _expect_refused(ctx, forged)
    assert by_session(ctx, token).role == "admin"


def test_a_key_has_so_many_sessions_and_the_oldest_go(ctx: Context) -> None:
    key = create_key(ctx, "ann", "operator")
    tokens = []
    for _ in range(MAX_SESSIONS + 1):
        tokens.append(start_session(ctx, key.key))
        ctx.clock.now += 1  # type: ignore[attr-defined]
    _expect_refused(ctx, tokens[0])
    assert all(by_session(ctx, token).name == "ann" for token in tokens[1:])


@pytest.mark.parametrize("token", ["", ".", "1.9999999999.00", "\0", "ü" * 10_000])
def test_another_token_is_no_session(ctx: Context, token: str) -> None:
    start_session(ctx, create_key(ctx, "ann", "operator").key)
    _expect_refused(ctx, token)


def _expect_refused(ctx: Context, token: str) -> None:
    with pytest.raises(UnauthorizedError):
        by_session(ctx, token)
