"""Draw the rooms of pipelines and stages with the imports between them: ``python docs/draw_rooms.py``.

Arrows point at what is imported; those that follow from others are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from texloom.pipelines.engine.code_digest import imports

ROOT = Path(__file__).parents[1]
FILE = ROOT / "docs" / "pictures" / "rooms.svg"
FLOORS = (
    *("pipelines", "stages/lookup", "stages/interactive", "stages/evaluation", "stages/synthesis"),
    *("stages/analysis", "stages/common", "stages/vocabulary", "stages/kernels"),
)

WIDTH, ROW, GAP, LEFT, RIGHT = 920, 40, 12, 130, 70  # px
Graph = dict[str, set[str]]
Place = tuple[float, float]

HEAD = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-size="13">
<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">
<path d="M0 0L8 4L0 8z" fill="#567"/></marker></defs>
<style>path.a{{fill:none;stroke:#567;marker-end:url(#tip)}}rect.r{{fill:#fff;stroke:#567}}
text{{font-family:sans-serif;text-anchor:middle;fill:#123}}text.f{{text-anchor:start;font-weight:bold}}</style>
<rect width="{width}" height="{height}" fill="#fff"/>
"""


def modules() -> Iterator[tuple[str, str, str]]:
    """Name, floor and room of each module; files of a floor that lie in no room share one without a name."""
    for floor in FLOORS:
        for path in sorted((ROOT / floor).rglob("*.py")):
            inner = path.relative_to(ROOT / floor).with_suffix("").parts
            if inner[-1] != "__init__":
                loose = inner[0] if floor == "pipelines" else ""
                yield ".".join(("texloom", *floor.split("/"), *inner)), floor, inner[0] if inner[1:] else loose


def joined(places: dict[str, str], floor_of: dict[str, str] | None = None) -> Graph:
    """The imports between the places of modules; with ``floor_of``, only those within one floor."""
    found: Graph = {place: set() for place in places.values()}
    for module, place in places.items():
        for other in imports(module):
            target = places.get(other, place)
            if target != place and (floor_of is None or floor_of[module] == floor_of[other]):
                found[place].add(target)
    return found


def reached(graph: Graph, starts: Iterable[str]) -> set[str]:
    """All that the imports of ``starts`` lead to."""
    found: set[str] = set()
    pending = list(starts)
    while pending:
        for one in graph[pending.pop()] - found:
            found.add(one)
            pending.append(one)
    return found


def reduced(graph: Graph) -> Graph:
    """The graph without arrows that follow from others; `ValueError` where it has a circle."""
    if ring := sorted(one for one in graph if one in reached(graph, [one])):
        raise ValueError(f"these import each other: {', '.join(ring)}")
    return {one: below - reached(graph, below) for one, below in graph.items()}


def rows(graph: Graph) -> list[list[str]]:
    """The rooms, each in a row above all that it imports."""
    depth: dict[str, int] = {}

    def below(room: str) -> int:
        if room not in depth:
            depth[room] = 1 + max((below(one) for one in sorted(graph[room])), default=-1)
        return depth[room]

    last = max(below(room) for room in sorted(graph))
    return [sorted(room for room in graph if depth[room] == last - row) for row in range(last + 1)]


def svg() -> str:
    """The picture."""
    listed = list(modules())
    floor_of = {name: floor for name, floor, _ in listed}
    rooms = {name: f"{floor}:{room}" for name, floor, room in listed}
    within = reduced(joined(rooms, floor_of))
    between = reduced(joined(floor_of))
    bands, boxes, places, middles = [], [], {}, {}
    top = 10.0
    for floor in FLOORS:
        own = {room: below for room, below in within.items() if room.startswith(f"{floor}:")}
        levels = rows(own)
        height = ROW * len(levels) + GAP
        middles[floor] = top + height / 2
        bands.append(f'<rect x="4" y="{top:.0f}" width="{WIDTH - RIGHT}" height="{height}" rx="6" fill="#e8eef2"/>')
        bands.append(
            f'<text class="f" x="14" y="{top + height / 2 + 4:.0f}">{floor.removeprefix("stages/")}</text>'
        )
        for index, level in enumerate(levels):
            step = (WIDTH - RIGHT - LEFT) / len(level)
            if index:  # below what imports them
                level.sort(key=lambda room: (mean(places[one][0] for one in own if room in own[one]), room))
            for number, room in enumerate(level):
                x, y = LEFT + step * (number + 0.5), top + GAP / 2 + ROW * (index + 0.5)
                places[room] = x, y
                boxes += box(room.partition(":")[2] or "files", x, y)
        top += height + 8
    arrows = [arrow(places[one], places[other]) for one in sorted(within) for other in sorted(within[one])]
    arrows += [arc(middles[one], middles[other]) for one in FLOORS for other in sorted(between[one])]
    return HEAD.format(width=WIDTH, height=round(top)) + "\n".join([*bands, *arrows, *boxes, "</svg>", ""])


def mean(values: Iterable[float]) -> float:
    """Of at least no values."""
    known = list(values)
    return sum(known) / len(known) if known else 0.0


def box(name: str, x: float, y: float) -> list[str]:
    """A room."""
    half = 4 * (len(name) + 3)
    return [
        f'<rect class="r" x="{x - half:.0f}" y="{y - 12:.0f}" width="{2 * half}" height="24" rx="4"/>',
        f'<text x="{x:.0f}" y="{y + 4:.0f}">{name}</text>',
    ]


def arrow(start: Place, end: Place) -> str:
    """From one room down to another."""
    (x, y), (to_x, to_y) = start, end
    bend = (to_y - y) / 3
    return (
        f'<path class="a" d="M{x:.0f} {y + 12:.0f}C{x:.0f} {y + 12 + bend:.0f} {to_x:.0f} {to_y - 12 - bend:.0f} '
        f'{to_x:.0f} {to_y - 12:.0f}"/>'
    )


def arc(start: float, end: float) -> str:
    """From one floor down to another, beside them."""
    x = WIDTH - RIGHT + 4
    far = x + min(RIGHT, 20 + (end - start) / 6)
    return f'<path class="a" d="M{x} {start:.0f}C{far:.0f} {start:.0f} {far:.0f} {end - 6:.0f} {x} {end - 6:.0f}"/>'


if __name__ == "__main__":
    FILE.write_text(svg(), encoding="utf-8")
