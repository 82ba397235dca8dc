"""TypeScript of all messages; ``python -m texloom.pipelines.studio.typescript`` writes the file of the page."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import pydantic

from texloom.pipelines.studio.messages import answers, catalogue, drawings, projects, recipes, requests, runs
from texloom.pipelines.studio.messages.message import Message

FILE = Path(__file__).parent / "client" / "src" / "messages.ts"
_HEAD = "// Written by texloom.pipelines.studio.typescript from the room messages; do not edit.\n"
_MODULES = (catalogue, recipes, runs, drawings, projects, requests, answers)
_PLAIN = {"string": "string", "integer": "number", "number": "number", "boolean": "boolean", "null": "null"}


def types() -> str:
    """The content of the file."""
    models = [
        one
        for module in _MODULES
        for one in vars(module).values()
        if inspect.isclass(one) and issubclass(one, Message) and one.__module__ == module.__name__
    ]
    parts = [_HEAD]
    for model in models:
        schema = model.model_json_schema(mode="serialization", ref_template="{model}")
        parts.append(_interface(model.__name__, schema, _required_to_send(model)))
    unions: dict[str, Any] = {"ToServer": requests.ToServer, "ToPage": answers.ToPage}
    for name, union in unions.items():
        members = pydantic.TypeAdapter(union).json_schema(ref_template="{model}")
        listed = [_type(one) for one in members.get("anyOf", [])] or [members["title"]]
        parts.append(f"export type {name} = {' | '.join(listed)};\n")
    return "\n".join(parts)


def _required_to_send(model: type[pydantic.BaseModel]) -> set[str]:
    """The fields that whoever makes the message must give: the kind, and those without default."""
    return {name for name, field in model.model_fields.items() if field.is_required() or name == "kind"}


def _interface(name: str, schema: dict[str, Any], required: set[str]) -> str:
    from_server = not name.endswith(("Request", "Recipe"))
    lines = [f"export interface {name} {{"]
    for field, kind in schema["properties"].items():
        optional = "" if from_server or field in required else "?"
        lines.append(f"  {field}{optional}: {_type(kind)};")
    return "\n".join([*lines, "}\n"])


def _type(schema: dict[str, Any]) -> str:
    """The type of a JSON schema."""
    if "$ref" in schema:
        return str(schema["$ref"])
    if "const" in schema:
        return f'"{schema["const"]}"'
    if "enum" in schema:
        return " | ".join(f'"{value}"' for value in schema["enum"])
    if "anyOf" in schema:
        return " | ".join(dict.fromkeys(_type(one) for one in schema["anyOf"]))
    kind = schema["type"]
    if kind == "array":
        if "prefixItems" in schema:
            return f"[{', '.join(_type(one) for one in schema['prefixItems'])}]"
        return f"({_type(schema['items'])})[]"
    if kind == "object":
        values = schema.get("additionalProperties") or next(iter(schema["patternProperties"].values()))
        return f"Record<string, {_type(values)}>"
    return _PLAIN[kind]


if __name__ == "__main__":
    FILE.write_text(types())
