"""Signatures of webhooks (Standard Webhooks 1.0, symmetric), by secrets that no copy of the database gives away.

A secret is derived from a salt, which is stored, and a key, which lies in a file of its own beside the database.
"""

import base64
import hashlib
import hmac
import os
import secrets
from pathlib import Path

from tidemap.errors import SecretFileError
from tidemap.settings import Settings

KEY_BYTES = 32
PREFIX = "whsec_"
_PURPOSE = b"tidemap webhook\0"


class Signer:
    """Signs with the secrets of salts."""

    def __init__(self, key: bytes) -> None:
        self._key = key

    def secret(self, salt: bytes) -> bytes:
        """The secret of a salt, 32 bytes."""
        return hmac.digest(self._key, _PURPOSE + salt, "sha256")

    def fingerprint(self, salt: bytes) -> bytes:
        """A hash of the secret of a salt, by which another key is noticed."""
        return hashlib.sha256(self.secret(salt)).digest()


def new_salt() -> bytes:
    """One that no other webhook has."""
    return secrets.token_bytes(16)


def shown_secret(secret: bytes) -> str:
    """A secret as receivers enter it."""
    return PREFIX + base64.b64encode(secret).decode()


def signature(secret: bytes, message_id: str, timestamp: int, body: bytes) -> str:
    """The value of `webhook-signature`.

    >>> secret = base64.b64decode("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw")
    >>> signature(secret, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}')
    'v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE='
    """
    signed = hmac.digest(secret, f"{message_id}.{timestamp}.".encode() + body, "sha256")
    return f"v1,{base64.b64encode(signed).decode()}"


def open_signer(settings: Settings) -> Signer:
    """With the key in the settings' file. Raises SecretFileError where there is none, or no key in it."""
    path = settings.secret_path
    try:
        key = base64.b64decode(path.read_bytes(), validate=True)
    except (OSError, ValueError) as error:
        raise SecretFileError(path, str(error)) from None
    if len(key) != KEY_BYTES:
        raise SecretFileError(path, f"it holds no key of {KEY_BYTES} bytes")
    return Signer(key)


def prepare_signer(settings: Settings) -> Signer:
    """As `open_signer`; where there is no file, with a new key in a new one that its owner alone may read."""
    path = settings.secret_path
    if not path.exists():
        try:
            _write_new(path, base64.b64encode(secrets.token_bytes(KEY_BYTES)))
        except OSError as error:
            raise SecretFileError(path, str(error)) from None
    return open_signer(settings)


def _write_new(path: Path, content: bytes) -> None:
    """Write a file whole, or leave the one that another process has just written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.{secrets.token_hex(8)}")
    descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if not path.exists():
            os.link(partial, path)
    except FileExistsError:
        return
    finally:
        partial.unlink()
