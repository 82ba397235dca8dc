"""What the page has to know of the flows that it offers."""

from __future__ import annotations

from typing import Any, Literal, get_args

from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Flow
from texloom.pipelines.flow.shipped import shipped_flows
from texloom.pipelines.studio.messages.catalogue import Method, OtherPicture
from texloom.pipelines.studio.offer import Offer
from texloom.pipelines.studio.offers import OFFERS

_SIDES = (1024, 1024)  # px, of a result whose flow has no size of its own
_UNIFORMITY = "occurrence"


def methods() -> list[Method]:
    """What the page has to know of each of `OFFERS`."""
    return [_method(name, offer) for name, offer in OFFERS.items()]


def _method(name: str, offer: Offer) -> Method:
    flow = load_flow(shipped_flows()[name])
    texture = flow.steps.get("texture")
    has_uniformity = texture is not None and _UNIFORMITY in type(texture.params).model_fields
    return Method(
        flow=name,
        about=offer.about,
        exemplar=next(iter(flow.sources)),
        begins=_begins(name, offer),
        has_maps=offer.is_texture and "maps/" in flow.exports and "maps/" not in flow.of_maps,
        size=(_default(flow, "size") or _SIDES) if "size" in flow.params else None,
        can_tile=offer.is_texture and "tileable" in flow.params,
        tiles=offer.is_texture and "tileable" in flow.params and bool(_default(flow, "tileable")),
        presets=_words(flow, "preset"),
        uniformity=f"texture.{_UNIFORMITY}" if has_uniformity else "",
        default_uniformity=getattr(texture.params, _UNIFORMITY) if texture is not None and has_uniformity else 0.0,
        others=tuple(
            OtherPicture(
                source=source,
                about=about,
                is_required=source not in flow.optional,
                painted=offer.painted.get(source),
            )
            for source, about in offer.others.items()
        ),
        several=offer.several,
        choices=offer.choices,
        controls=offer.controls,
        views=offer.views,
        is_texture=offer.is_texture,
        can_correct=offer.is_texture and offer.several is None and offer.layer in ("", "collage"),
        layer=offer.layer,
    )


def _begins(name: str, offer: Offer) -> Literal["picture", "maps", "photograph"]:
    if offer.surface or offer.layer == "surfaces":
        return "photograph"
    return "maps" if name == "materials" else "picture"


def _default(flow: Flow, name: str) -> Any:
    step, _, param = flow.params[name][0].partition(".")
    return getattr(flow.steps[step].params, param)


def _words(flow: Flow, name: str) -> tuple[str, ...]:
    """The values that a param can have, where they are words."""
    step, _, param = flow.params.get(name, ("",))[0].partition(".")
    return get_args(type(flow.steps[step].params).model_fields[param].annotation) if step else ()
