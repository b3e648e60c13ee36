"""The documentation of the API as a page: its OpenAPI document in words, with a form to try each operation."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from fastapi import APIRouter, Request, Response
from markupsafe import Markup, escape

from tidemap.api.addresses import BASE
from tidemap.media_types import JSON
from tidemap.services.context import Context
from tidemap_web.pages import guard
from tidemap_web.pages.templates import page

Schema = Mapping[str, Any]
SCHEMAS = "#/components/schemas/"
_BOUNDS = (
    ("minimum", "≥ {:g}"),
    ("exclusiveMinimum", "> {:g}"),
    ("maximum", "≤ {:g}"),
    ("exclusiveMaximum", "< {:g}"),
    ("minLength", "{} characters or more"),
    ("maxLength", "{} characters at most"),
    ("minItems", "{} or more"),
    ("maxItems", "{} at most"),
)
_CODE = Markup("<code>{}</code>")
_TYPES = {"array": "list", "null": "null", "object": "object"}


@dataclass(frozen=True, slots=True)
class Parameter:
    """A part of a request; `where` is path, query or header."""

    name: str
    where: str
    required: bool
    schema: Schema
    description: str


@dataclass(frozen=True, slots=True)
class DescribedAnswer:
    """What comes back with a status; `schema` and `example` where it is JSON that is no problem document."""

    status: str
    description: str
    media_types: Sequence[str]
    schema: Schema | None
    example: str | None


@dataclass(frozen=True, slots=True)
class Operation:
    """What can be asked; `bodies` are schemas by media type, `example` a JSON body to begin with."""

    id: str
    tag: str
    method: str
    path: str
    description: str
    parameters: Sequence[Parameter]
    about_body: str
    bodies: Mapping[str, Schema]
    example: str | None
    answers: Sequence[DescribedAnswer]


def router(ctx: Context, document: Callable[[], Mapping[str, Any]]) -> APIRouter:
    """The page of a document; it needs no sign-in."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/api/docs", response_model=None)
    def documentation(request: Request) -> Response:
        """The page, with nothing from any other host."""
        found = document()
        groups = [(tag, list(each)) for tag, each in groupby(_operations(found), key=lambda each: each.tag)]
        facts = {
            "about": found["info"],
            "openapi": f"{BASE}/openapi.json",
            "groups": groups,
            "schemas": found["components"]["schemas"],
            "kind": kind,
            "coded": coded,
        }
        return page(request, "api_docs.html", {**guard.header(ctx, request), **facts})

    return routes


def coded(text: str) -> Markup:
    """Text with what stands between backticks as code.

    >>> coded("Not `<b>`")
    Markup('Not <code>&lt;b&gt;</code>')
    """
    parts = text.split("`")
    return Markup("").join(_CODE.format(part) if number % 2 else escape(part) for number, part in enumerate(parts))


def kind(schema: Schema) -> Iterator[tuple[str, str | None]]:
    """What a value is, as pieces of text, each with the name of a schema that it leads to.

    >>> list(kind({"anyOf": [{"type": "number", "minimum": 0.5}, {"type": "null"}]}))
    [('number ≥ 0.5', None), (' or ', None), ('null', None)]
    >>> list(kind({"type": "array", "items": {"$ref": "#/components/schemas/Grid"}}))
    [('list of ', None), ('Grid', 'Grid')]
    """
    if "$ref" in schema:
        name = schema["$ref"].removeprefix(SCHEMAS)
        yield name, name
    elif choices := schema.get("anyOf") or schema.get("oneOf"):
        for number, each in enumerate(choices):
            if number:
                yield " or ", None
            yield from kind(each)
    elif schema.get("type") == "array" and "items" in schema:
        yield f"list{_bounds(schema)} of ", None
        yield from kind(schema["items"])
    elif "enum" in schema:
        yield " | ".join(str(each) for each in schema["enum"]), None
    elif "const" in schema:
        yield f'"{schema["const"]}"', None
    else:
        name = _TYPES.get(schema.get("type", ""), schema.get("type", "anything"))
        form = f", {schema['format']}" if "format" in schema else ""
        yield f"{name}{form}{_bounds(schema)}", None


def _bounds(schema: Schema) -> str:
    said = [text.format(schema[name]) for name, text in _BOUNDS if name in schema]
    return f" {', '.join(said)}" if said else ""


def _operations(document: Mapping[str, Any]) -> list[Operation]:
    """In order of the tags as they first come."""
    found = [
        _operation(document, method, path, each)
        for path, methods in document["paths"].items()
        for method, each in methods.items()
    ]
    order = list(dict.fromkeys(each.tag for each in found))
    return sorted(found, key=lambda each: order.index(each.tag))


def _operation(document: Mapping[str, Any], method: str, path: str, said: Mapping[str, Any]) -> Operation:
    body = said.get("requestBody", {})
    content = body.get("content", {})
    return Operation(
        said["operationId"],
        said["tags"][0],
        method.upper(),
        path,
        said.get("description") or said.get("summary", ""),
        [_parameter(each) for each in said.get("parameters", [])],
        body.get("description", ""),
        {name: each["schema"] for name, each in content.items()},
        _body_example(document, content[JSON]) if JSON in content else None,
        [_answer(status, each) for status, each in said["responses"].items()],
    )


def _parameter(said: Mapping[str, Any]) -> Parameter:
    """One that is left out is null: nobody sends that."""
    choices = [each for each in said["schema"].get("anyOf", []) if each != {"type": "null"}]
    schema = {**said["schema"], **({"anyOf": choices} if choices else {})}
    return Parameter(said["name"], said["in"], said.get("required", False), schema, said.get("description", ""))


def _answer(status: str, said: Mapping[str, Any]) -> DescribedAnswer:
    content, about = said.get("content", {}), said["description"].replace("Successful Response", "What was asked for")
    plain = content.get(JSON)
    if plain is None:
        return DescribedAnswer(status, about, list(content), None, None)
    example = _text(plain["example"]) if "example" in plain else None
    return DescribedAnswer(status, about, list(content), plain.get("schema"), example)


def _body_example(document: Mapping[str, Any], content: Mapping[str, Any]) -> str:
    """The first example that is given, or one of the fields that have some."""
    for each in content.get("examples", {}).values():
        return _text(each["value"])
    name = content["schema"].get("$ref", "").removeprefix(SCHEMAS)
    fields = document["components"]["schemas"].get(name, {}).get("properties", {})
    return _text({field: each["examples"][0] for field, each in fields.items() if "examples" in each})


def _text(value: object) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False)
