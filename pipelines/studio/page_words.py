"""Problems in the words of the page: what to choose in it, in place of options of the command line."""

from __future__ import annotations

import re
from collections.abc import Iterator

import yaml

from texloom.pipelines.studio.offers import OFFERS

_OPTION = re.compile(
    r"--(set|source|seeds?|size|tileable|preset|crop|reduce)\b(?:[ =]'?([\w.]+)(?:=([\w.,/-]*\w))?'?)?"
)
_LEFT_OUT = "paint it on the layer Guides, under Leave out"
_FILE = "the flow file, which Show as YAML or command has"


def page_words(problem: str) -> str:
    """A problem with the options that it names replaced by what the page calls them.

    Examples
    --------
    >>> page_words("image: it is not alike, --set accept=true goes on")
    'image: it is not alike, “Also if it has structure” goes on'
    """
    return _OPTION.sub(_words, problem)


def _words(option: re.Match[str]) -> str:
    kind, name, value = option[1], option[2], option[3]
    match kind:
        case "seed" | "seeds":
            return f"Seed {name}" if kind == "seed" and name else "other seeds"
        case "size" | "tileable" | "preset":
            return f"{kind.capitalize()} {name or ''}".strip()
        case "crop":
            return "a part of it as a file of its own"
        case "reduce":
            return "a smaller copy of it"
        case "source" if name == "mask":
            return _LEFT_OUT
        case _ if name is None:
            return "a setting"
        case "source":
            return next((f"“{offer.others[name]}”" for offer in OFFERS.values() if name in offer.others), name)
    if name.rpartition(".")[2] == "geometry":
        return "Place surfaces by hand"
    return next(_controls(name, value), f"{name}: {value} in {_FILE}")


def _controls(name: str, text: str | None) -> Iterator[str]:
    """The choices and sliders of the page that set a param to a value."""
    value = yaml.safe_load(text or "")
    for offer in OFFERS.values():
        for choice in offer.choices:
            yield from (f"{choice.label}: {one.name}" for one in choice.settings if one.params == {name: value})
        for control in offer.controls:
            if control.param == name:
                yield f"“{control.label}”" if control.is_switch else f"“{control.label}” at {text}"
