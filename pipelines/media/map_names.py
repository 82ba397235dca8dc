"""What the names of a material's files say: which map each holds, in which channels, and where green points.

The names of a folder are read together, by the table `texloom.pipelines.media.conventions.LAYOUTS`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

from texloom.pipelines.media import udim
from texloom.pipelines.media.conventions import COLORS, CONVENTION_OF, LAYOUTS, role_of
from texloom.pipelines.media.name_words import JUNK, largest, stem_of, trimmed, words_of

_GREEN = {"gl": "up", "opengl": "up", "ogl": "up", "dx": "down", "directx": "down"}
_NOUNS = ("map", "maps", "tex", "texture")
_PREVIEW = re.compile(r"(?:preview|thumb|thumbnail|render|sphere|cube)\d*")
_DEEP = re.compile(r"[a-z](?:16|32)(?![a-z0-9])|(?<![a-z0-9])(?:16|32)-?bit")
_LONGEST = 4  # words of a suffix
_MOST = 4096  # combinations of readings
_LETTERS = "RGBA"


@dataclasses.dataclass(frozen=True)
class Reading:
    """What a file's name may mean."""

    planes: tuple[str, ...]
    """as of `texloom.pipelines.media.conventions.LayoutFile`"""
    layouts: frozenset[str]
    rare: bool

    @property
    def roles(self) -> tuple[str, ...]:
        """The roles of its planes."""
        return tuple(role_of(plane)[0] for plane in self.planes if plane)

    @property
    def is_plain(self) -> bool:
        """Whether it is one map as it is."""
        return len(self.planes) == 1 and not role_of(self.planes[0])[1]

    def __str__(self) -> str:
        return "+".join(plane or "-" for plane in self.planes)


@dataclasses.dataclass(frozen=True)
class Claim:
    """A file that holds a map, by its name or by a YAML file."""

    reference: str
    """of UDIM tiles ``name.<UDIM>.png``"""
    plane: str = ""
    """the channel, such as ``R``; empty: all of the file"""
    inverted: bool = False
    green: str = ""
    """where it points, by the name"""
    curve: str = ""
    """that its values went through, one of `texloom.pipelines.media.curves.CURVES`"""

    @property
    def path(self) -> Path:
        """Where it is; of a picture that ships, its reference as a path."""
        return Path(self.reference)


@dataclasses.dataclass(frozen=True)
class Named:
    """What the names of a folder say."""

    claims: Mapping[str, tuple[Claim, ...]]
    """role to files, of which the first is the one to use"""
    unknown: tuple[Path, ...]
    """files whose names are those of no map"""
    previews: tuple[Path, ...] = ()
    doubts: Mapping[Path, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """file to what it may be"""
    layouts: tuple[str, ...] = ()
    """entries of the table that explain most of the names"""
    several: Mapping[str, tuple[Path, ...]] = dataclasses.field(default_factory=dict)
    """role to files that are named as the same"""
    smaller: tuple[Path, ...] = ()
    """files that are there with more pixels too, by their names"""

    @property
    def packed(self) -> dict[Path, list[str]]:
        """Files with several or inverted maps, and what is in them: channel and plane."""
        found: dict[Path, list[str]] = {}
        for role, claims in self.claims.items():
            one = claims[0]
            if one.plane or one.inverted:
                held = f"1-{role}" if one.inverted else role
                found.setdefault(one.path, []).append(f"{one.plane} {held}".strip())
        return found

    @property
    def green(self) -> str:
        """Where it points in normals, if all those layouts agree on it."""
        greens = {LAYOUTS[name].green for name in self.layouts}
        return next(iter(greens)) if len(greens) == 1 else ""


def recognised(name: str) -> tuple[str, str | None] | None:
    """The role in one name, and the convention of a normal map if it is there; None without one role."""
    found = recognised_plane(name)
    if found is None or found[1]:
        return None
    return found[0], CONVENTION_OF.get(found[2])


def recognised_plane(name: str) -> tuple[str, bool, str] | None:
    """As `recognised`: the role, whether it is inverted, and where green points, or an empty text."""
    found = _readings(name)
    if found is None:
        return None
    key, readings, green = found
    usual = {one.planes for one in readings if not one.rare}
    planes = next(iter(usual), ())
    if len(key) == 1 or len(usual) != 1 or len(planes) != 1:
        return None
    return *role_of(planes[0]), green


@cache
def _table() -> Mapping[str, tuple[Reading, ...]]:
    """What each suffix may mean."""
    found: dict[str, dict[tuple[tuple[str, ...], bool], set[str]]] = {}
    for name, layout in LAYOUTS.items():
        for part in layout.parts:
            for suffix in (part.suffix, *part.also):
                words = words_of(suffix)
                words = words[:-1] if words[-1] in _GREEN else words
                found.setdefault("".join(words), {}).setdefault((part.planes, part.rare), set()).add(name)
    return {
        key: tuple(Reading(planes, frozenset(names), rare) for (planes, rare), names in meanings.items())
        for key, meanings in found.items()
    }


def _readings(name: str | list[str]) -> tuple[str, tuple[Reading, ...], str] | None:
    """The suffix of a name, what it may mean, and where green points by it."""
    words = trimmed(words_of(name) if isinstance(name, str) else name)
    green = _GREEN.get(words[-1], "") if words else ""
    if green:
        words = words[:-1]
    elif words and (joined := re.fullmatch(r"(normals?|nor|nrm)(opengl|ogl|gl|directx|dx)", words[-1])):
        words, green = [*words[:-1], joined[1]], _GREEN[joined[2]]
    for key in _suffixes(words):
        readings = _table().get(key)
        if readings is not None:
            readings = tuple(one for one in readings if not green or one.roles == ("normal",))
            return (key, readings, green) if readings else None
    return None


def _suffixes(words: list[str]) -> Iterator[str]:
    """What a name ends in, the longest first; then without such a noun as map, or digits, as of ``disp16``."""
    shorter = list(words)
    while shorter and shorter[-1] in _NOUNS:
        shorter = trimmed(shorter[:-1])
    for some in (words, shorter) if shorter != words else (words,):
        for count in range(min(_LONGEST, len(some)), 0, -1):
            yield "".join(some[-count:])
    if shorter and (bare := re.fullmatch(r"([a-z]{2,})(?:8|16|32)", shorter[-1])):
        yield bare[1]


def read_names(paths: Sequence[Path], is_grey: Callable[[Path], bool | None]) -> Named:
    """What the names of a folder's pictures say.

    A suffix that may mean several things is decided by the other names, and by content where they leave it open.

    Parameters
    ----------
    is_grey : whether a picture is grey; nothing where that cannot be known.
    """
    kept, smaller = largest(whole_files(paths))
    words = {path: words_of(stem_of(path)) for path in kept}
    found = {path: _readings(one) for path, one in words.items()}
    _read_beginnings(words, found)
    shared = _shared(list(words.values()))
    found |= {path: None for path, one in found.items() if one and len(one[0]) == 1 and words[path] == shared}
    options = {path: one for path, one in found.items() if one is not None}
    named = any(one.roles == ("normal",) or len(key) > 1 for key, some, _ in options.values() for one in some)
    if not named and not _letters_tell({path: one[0] for path, one in options.items()}, is_grey):
        options = {}
    unknown = [path for path in words if path not in options]
    chosen, doubts, layouts = _decided(options, is_grey)
    # as in Minecraft's resource packs: stone.png, stone_n.png
    bare = [path for path in unknown if trimmed(words[path]) == trimmed(shared)]
    if len(bare) == 1 and chosen and not any("albedo" in one.roles for one in chosen.values()):
        chosen[bare[0]] = Reading(("albedo",), frozenset(), rare=False)
        unknown.remove(bare[0])
    claims, several = _claims(chosen, {path: one[2] for path, one in options.items()})
    previews = tuple(path for path in unknown if _is_preview(words[path]) or path in bare)
    rest = tuple(path for path in unknown if path not in previews)
    return Named(claims, rest, previews, doubts, layouts, several, smaller)


def _letters_tell(keys: Mapping[Path, str], is_grey: Callable[[Path], bool | None]) -> bool:
    """Whether names that end in single letters are of maps: they are no run of the alphabet, and one has colour."""
    letters = sorted({*keys.values()})
    if len(letters) < 2 or ord(letters[-1]) - ord(letters[0]) < len(letters):
        return False
    greys = [is_grey(path) for path in keys]
    return greys.count(False) == 1 or not any(grey is not None for grey in greys)


def several_materials(paths: Sequence[Path], is_grey: Callable[[Path], bool | None]) -> dict[str, Named]:
    """The materials of a folder by what the names of their files begin with; empty where there are not several.

    Each has an albedo and other maps.
    """
    groups: dict[str, list[Path]] = {}
    smaller = set(largest(whole_files(paths))[1])
    for path in (one for one in paths if one not in smaller):
        words = words_of(stem_of(path))
        if (start := _beginning(words)) is not None:
            name = unicodedata.normalize("NFC", path.name)
            letters = [place for place, letter in enumerate(name) if letter.isalnum()]
            length = len("".join(words[:start]))
            groups.setdefault(name[: letters[length - 1] + 1] if length else "", []).append(path)
    named = {name: read_names(files, is_grey) for name, files in groups.items() if name}
    whole = {name: one for name, one in named.items() if "albedo" in one.claims and len(one.claims) > 1}
    return whole if len(whole) > 1 else {}


def of_other_beginning(first: Path, others: Sequence[Path]) -> list[Path]:
    """The files whose names begin otherwise than that of ``first``, but for sizes, variants and single letters."""
    starts = {path: _name_of_material(path) for path in (first, *others)}
    return [path for path in others if starts[first] and starts[path] and starts[path] != starts[first]]


def _name_of_material(path: Path) -> str:
    words = words_of(stem_of(path))
    start = words[: _beginning(words) or 0]
    return "".join(word for word in start if len(word) > 1 and not JUNK.fullmatch(word))


def _beginning(words: list[str]) -> int | None:
    """How many words a name has before those that say its map; nothing where none do."""
    found = _readings(words)
    if found is None:
        return None
    return next(end for end in range(len(words) - 1, -1, -1) if _readings(words[end:]) == found)


def whole_files(paths: Sequence[Path]) -> list[Path]:
    """Files by name, with the UDIM tiles of a map as one, see `texloom.pipelines.media.udim`."""
    return sorted(udim.joined(paths, lambda stem: _readings(stem) is not None))


def shared_words(paths: Sequence[Path]) -> list[str]:
    """The words that all names begin with."""
    return _shared([words_of(path.stem) for path in paths])


def _shared(names: Sequence[Sequence[str]]) -> list[str]:
    columns = zip(*names, strict=False)
    return [words[0] for words in itertools.takewhile(lambda words: len(set(words)) == 1, columns)]


def _is_preview(words: Sequence[str]) -> bool:
    return any(map(_PREVIEW.fullmatch, words[-2:]))


def _read_beginnings(words: Mapping[Path, list[str]], found: dict[Path, tuple | None]) -> None:
    """Names that end in the same words and begin with what they hold, as ``normal_moss``."""
    open_ = [
        path for path, one in found.items() if (one is None or len(one[0]) == 1) and not _is_preview(words[path])
    ]
    ends = _shared([words[path][::-1] for path in open_])
    if len(open_) > 1 and ends:
        for path in open_:
            found[path] = _readings(words[path][: -len(ends)])


def _decided(
    options: Mapping[Path, tuple[str, tuple[Reading, ...], str]], is_grey: Callable[[Path], bool | None]
) -> tuple[dict[Path, Reading], dict[Path, tuple[str, ...]], tuple[str, ...]]:
    """The reading of each file; what those in doubt may be; the layouts that explain most."""
    paths = list(options)
    readings = [options[path][1] for path in paths]
    if not paths:
        return {}, {}, ()
    if math.prod(map(len, readings)) > _MOST:
        readings = [tuple(one for one in some if not one.rare) or some for some in readings]
    prefixed = {
        name: 1 if all(path.name.startswith(one.prefix) for path in paths) else -1
        for name, one in LAYOUTS.items()
        if one.prefix
    }
    scored = sorted(
        ((_score(some, prefixed), some) for some in itertools.islice(itertools.product(*readings), _MOST)),
        key=lambda one: one[0],
        reverse=True,
    )
    best = [some for score, some in scored if score == scored[0][0]]
    if len({tuple(one.planes for one in some) for some in best}) > 1:
        greys = list(map(is_grey, paths))
        fitting = [sum(map(_fits, some, greys)) for some in best]
        best = [some for some, count in zip(best, fitting, strict=True) if count == max(fitting)]
    doubts = {}
    for place, path in enumerate(paths):
        meanings = tuple(dict.fromkeys(str(some[place]) for some in best))
        if len(meanings) > 1:
            doubts[path] = meanings
    counts = _explained(best[0], prefixed)
    layouts = tuple(name for name, count in counts.items() if count and count == max(counts.values()))
    return dict(zip(paths, best[0], strict=True)), doubts, layouts


def _score(some: Sequence[Reading], prefixed: Mapping[str, int]) -> tuple[int, bool, int, int]:
    """How well readings go together: conflicts, an albedo, what one layout explains, what is rare."""
    plain = [one.planes[0] for one in some if one.is_plain]
    conflicts = len(plain) - len(set(plain))
    has_albedo = any("albedo" in one.roles for one in some)
    return -conflicts, has_albedo, max(_explained(some, prefixed).values()), -sum(one.rare for one in some)


def _explained(some: Sequence[Reading], prefixed: Mapping[str, int]) -> dict[str, int]:
    """How many of the files each layout has; one more or less by whether they have its prefix."""
    return {name: sum(name in one.layouts for one in some) + prefixed.get(name, 0) for name in LAYOUTS}


def _fits(reading: Reading, grey: bool | None) -> bool:
    """Whether the colour of a file is that of its map."""
    if grey is None or not reading.is_plain:
        return not (grey and sum(map(bool, reading.planes[:3])) > 1)
    colored = (*COLORS, "normal", "specular")
    return reading.planes[0] in colored if not grey else reading.planes[0] not in ("albedo", "normal")


def _claims(
    chosen: Mapping[Path, Reading], greens: Mapping[Path, str]
) -> tuple[dict[str, tuple[Claim, ...]], dict[str, tuple[Path, ...]]]:
    """Role to files, those first that hold it alone and as it is; and roles that several files are named as."""
    found: dict[str, list[Claim]] = {}
    for path, reading in chosen.items():
        for plane in filter(None, dict.fromkeys(reading.planes)):
            role, inverted = role_of(plane)
            is_channel = len(reading.planes) > 1 and reading.planes.count(plane) == 1
            place = _LETTERS[reading.planes.index(plane)] if is_channel else ""
            found.setdefault(role, []).append(Claim(str(path), place, inverted, greens.get(path, "")))
    if "bump" in found and "height" not in found:
        found["height"] = found.pop("bump")
    several = {}
    for role, claims in found.items():
        claims.sort(key=_rank)
        first = [one for one in claims if _rank(one) == _rank(claims[0])]
        if len(first) > 1:
            several[role] = tuple(one.path for one in first)
    return {role: tuple(claims) for role, claims in found.items()}, several


def _rank(claim: Claim) -> tuple[bool, bool, int, bool, int]:
    variant = re.search(r"var(\d+)", claim.path.stem.lower())
    return (
        bool(claim.plane),
        claim.inverted,
        ("up", "", "down").index(claim.green),
        _DEEP.search(claim.path.stem.lower()) is None,
        int(variant[1]) if variant else 0,
    )
