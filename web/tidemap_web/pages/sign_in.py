"""The form that a browser signs in with: small, and read only as browsers send it."""

from dataclasses import dataclass
from urllib.parse import parse_qs

from fastapi import Request

from tidemap.api.bodies import read_body
from tidemap.api.state import state_of
from tidemap.errors import UnreadableBodyError, UnsupportedMediaTypeError

MAX_FORM_BYTES = 1 << 14
MEDIA_TYPE = "application/x-www-form-urlencoded"


@dataclass(frozen=True, slots=True)
class SignInForm:
    """A key, and the page to go on to."""

    key: str
    next: str


async def sign_in_form(request: Request) -> SignInForm:
    """The form in a request. Raises UnsupportedMediaTypeError, UnreadableBodyError, and as `read_body`."""
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if media_type != MEDIA_TYPE:
        raise UnsupportedMediaTypeError("Sign in with the form on this page.")
    with state_of(request).budget.share() as share:
        content = await read_body(request, MAX_FORM_BYTES, share)
    try:
        fields = parse_qs(content.decode("ascii"), strict_parsing=True, max_num_fields=10, errors="strict")
        return SignInForm(fields["key"][0].strip(), fields.get("next", ["/"])[0])
    except (ValueError, KeyError):
        raise UnreadableBodyError("The form came without a key. Enter one and send it again.") from None
