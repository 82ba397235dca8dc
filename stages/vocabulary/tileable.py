"""What may be asked for of the borders of a result: ``off``, ``x``, ``y`` or ``both``."""

from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer, PlainValidator, WithJsonSchema

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

NAMES = ("off", "x", "y", "both")
"""as they are typed; false and true say ``off`` and ``both``"""
_EXPECTED = "off, x (left and right borders), y (top and bottom) or both"


def parse_tileable(value: Any) -> Wraps:
    """The borders that a name or a truth value asks for; `ValueError` if it is neither."""
    if isinstance(value, Wraps):
        return value
    if isinstance(value, bool) or value in ("true", "false"):
        return TORUS if value in (True, "true") else NOWHERE
    if value not in NAMES:
        raise ValueError(f"{value!r} is not {_EXPECTED}")
    return Wraps.of(value)


def wraps_after(asked: Wraps | None, before: Wraps) -> Wraps:
    """Where an edited picture wraps: where it did, and where it is asked to; nowhere if that is ``off``."""
    return before if asked is None else (asked | before if asked else asked)


def tileable_value(wraps: Wraps) -> bool | str:
    """The shortest value that asks for it: a truth value, ``x`` or ``y``."""
    return wraps.both if wraps.both or not wraps else str(wraps)


def _on_both_axes(value: Any) -> bool:
    wraps = parse_tileable(value)
    if wraps and not wraps.both:
        raise ValueError(f"'{wraps}': a compaction is tileable along both axes or along none; both or off")
    return wraps.both


Tileable = Annotated[
    Wraps,
    PlainValidator(parse_tileable),
    PlainSerializer(tileable_value, return_type=bool | str),
    WithJsonSchema({"anyOf": [{"type": "boolean"}, {"enum": list(NAMES)}]}),
]
"""the borders across which a result continues"""
TileableBoth = Annotated[bool, BeforeValidator(_on_both_axes)]
"""the same for compactions, which are read around a torus or not at all; one axis is refused"""


def check_continues(image: Image) -> None:
    """`InputError` unless the image continues across all its borders."""
    if not image.wraps.both:
        raise InputError("image: does not continue across its borders; the flow make_tileable makes it do so")
