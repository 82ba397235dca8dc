"""Plots: SVG that takes the font and text colour of the page around, or pictures."""

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from texloom.stages.evaluation._pages.text import writable
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

_BLUE, _ORANGE, _PURPLE = "#0072b2", "#e69f00", "#cc79a7"  # Okabe and Ito's, for colour-blind eyes too
_CURVE_COLORS = (_BLUE, _ORANGE, _PURPLE, "#009e73", "#606060", "#56b4e9")
_DASH = 12  # px
_WIDTH, _HEIGHT = 480, 278  # px, of a panel of bars
_STEPS = np.array([1, 2, 5, 10, 20, 50])  # between ticks, times a power of ten
_MOST_TICKS = 5
_MAX_LABEL = 28  # characters; more leave no room for the plot
_LETTER = 6.2  # px; width of most letters at the size of the labels
_TURN = 35  # degrees; of the labels below an axis
_METHOD = 26  # px; least distance of two methods, whose turned labels then lie apart
_CURVE = (1200, 750)  # px; width and height of `size_curve`
_SCALE = 3  # pixels that become one: smooth lines


def energies(scales: Sequence[Mapping[str, Any]]) -> str:
    """Final energy and share of changed patches of every scale; see `Optimised.scales`.

    Returns
    -------
    SVG; empty where no scale has an energy.
    """
    energy, price, changed = (
        np.array([_number(scale.get(name)) for scale in scales], np.float64)
        for name in ("energy", "price", "changed")
    )
    if not np.isfinite(energy).any():
        return ""
    price = np.nan_to_num(price)
    labels = [f"{scale.get('width', '?')} x {scale.get('height', '?')}" for scale in scales]
    parts = {"appearance": (energy - price, _BLUE), "occurrence penalty": (price, _ORANGE)}
    panels = (
        _bars("energy per patch, CIELAB units² per pixel", labels, parts),
        _bars("patches changed in the last round, %", labels, {"": (100 * changed, _PURPLE)}),
    )
    return _svg(2.0 * _WIDTH, float(_HEIGHT), [panels[0], f'<g transform="translate({_WIDTH})">{panels[1]}</g>'])


def _bars(title: str, labels: Sequence[str], parts: Mapping[str, tuple[np.ndarray, str]]) -> str:
    """A panel of bars, each the sum of its ``parts``: name to values and colour."""
    left, right, top, bottom = 44.0, _WIDTH - 16.0, 28.0, _HEIGHT - 62.0
    highest = max(float(np.nan_to_num(sum(values for values, _ in parts.values())).max()), 0.0) or 1.0
    unit = (bottom - top) / highest
    drawn = [f'<text x="{left:.0f}" y="14">{title}</text>']
    for tick in _ticks(highest):
        y = bottom - tick * unit
        drawn += [
            _rule(left, right, y),
            f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:.4g}</text>',
        ]
    spacing = (right - left) / len(labels)
    for place, label in enumerate(labels):
        x, y = left + (place + 0.1) * spacing, float(bottom)
        for values, color in parts.values():
            height = float(np.nan_to_num(values[place])) * unit
            y -= height
            drawn.append(
                f'<rect x="{x:.1f}" y="{y:.1f}" width="{0.8 * spacing:.1f}" height="{max(height, 0):.1f}" '
                f'fill="{color}"/>'
            )
        drawn.append(_turned(left + (place + 0.5) * spacing, bottom, writable(label)))
    for number, (name, (_, color)) in enumerate(parts.items() if len(parts) > 1 else ()):
        y = top + 18 * number
        drawn.append(f'<rect x="{right - 140}" y="{y}" width="18" height="9" fill="{color}"/>')
        drawn.append(f'<text x="{right - 116}" y="{y + 9}">{name}</text>')
    return "".join(drawn)


def paired_scores(axes_scores: Mapping[str, Mapping[str, Sequence[float | None]]]) -> str:
    """Scores by axis and method: a dot for each mean, a thin line for each item with scores of all methods.

    Parameters
    ----------
    axes_scores : axis to method to one score an item, None where there is none.

    Returns
    -------
    SVG; empty where no item has all scores of an axis.
    """
    paired = {}
    for axis, by_method in axes_scores.items():
        values = np.array([[_number(score) for score in scores] for scores in by_method.values()], np.float64)
        values = values.reshape(len(by_method), -1)
        values = values[:, np.isfinite(values).all(axis=0)]
        if values.size:
            paired[axis] = values
    if not paired:
        return ""
    names = list(map(_label, axes_scores[next(iter(paired))]))
    top, bottom, gap = 28.0, 210.0, 24.0
    reach = np.array([14 + _LETTER * len(name) for name in names])  # of labels, from the bottom of the axis
    across, down = np.cos(np.radians(_TURN)), np.sin(np.radians(_TURN))
    first = max(44.0, float((reach * across - _METHOD * np.arange(len(names))).max()))
    spacing = max((2 * _WIDTH - first) / len(paired) - gap, _METHOD * len(names)) / len(names)
    drawn, left = [], first
    for axis, values in paired.items():
        right = left + spacing * len(names)
        drawn.append(f'<text x="{left:.1f}" y="14">{html.escape(writable(axis))}</text>')
        for tick in np.linspace(0, 1, 6):
            y = bottom - tick * (bottom - top)
            drawn.append(_rule(left, right, y))
            if left == first:
                drawn.append(f'<text x="{left - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{tick:.1f}</text>')
        places = left + (np.arange(len(names)) + 0.5) * spacing
        for item in values.T:
            points = " ".join(
                f"{x:.1f},{bottom - y * (bottom - top):.1f}" for x, y in zip(places, item, strict=True)
            )
            drawn.append(f'<polyline points="{points}" fill="none" stroke="currentColor" stroke-opacity=".35"/>')
        for x, mean, name in zip(places, values.mean(axis=1), names, strict=True):
            drawn.append(f'<circle cx="{x:.1f}" cy="{bottom - mean * (bottom - top):.1f}" r="4" fill="{_BLUE}"/>')
            drawn.append(_turned(x, bottom, name))
        left = right + gap
    return _svg(left, bottom + 24 + float(reach.max()) * down, drawn)


def _svg(width: float, height: float, drawn: Iterable[str]) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" '
        f'font-size="12" fill="currentColor">{"".join(drawn)}</svg>'
    )


def _rule(left: float, right: float, y: float) -> str:
    return f'<path d="M{left:.1f} {y:.1f}H{right:.1f}" stroke="currentColor" stroke-opacity=".15"/>'


def _turned(x: float, bottom: float, label: str) -> str:
    """A label below the place ``x`` of an axis."""
    place = f"translate({x + 4:.1f} {bottom + 14:.1f}) rotate(-{_TURN})"
    return f'<text transform="{place}" text-anchor="end">{html.escape(label)}</text>'


def _ticks(highest: float) -> list[float]:
    """Round numbers from 0 up to ``highest``."""
    step = next(step for step in _STEPS * 10.0 ** np.floor(np.log10(highest) - 1) if highest <= _MOST_TICKS * step)
    return [tick for tick in np.arange(0, highest + step / 2, step) if tick <= highest * 1.001]


def _label(text: str) -> str:
    return writable(text if len(text) <= _MAX_LABEL else text[: _MAX_LABEL - 1] + "…")


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


def size_curves(
    sizes: list[float], curves: Mapping[str, list[float]], knee: float, titles: tuple[str, str], unit: str
) -> Image:
    """Curves over the size of a compaction as a picture, with the knee marked.

    ``titles`` are those of the vertical and the horizontal axis; the knee is given in ``unit``.
    """
    import PIL.Image
    import PIL.ImageDraw

    made = PIL.Image.new("RGB", (_CURVE[0] * _SCALE, _CURVE[1] * _SCALE), "white")
    drawing = _Drawing(PIL.ImageDraw.Draw(made))
    left, right, top, bottom = 90.0, 1170.0, 60.0, 650.0
    highest = max(max(values) for values in curves.values()) * 1.05 or 1.0

    def across(value: float | int) -> float:
        return float(left + (right - left - 20) * value / sizes[-1])

    def down(value: float) -> float:
        return float(bottom - (bottom - top) * value / highest)

    drawing.text((left, 40.0), titles[0], "ls")
    drawing.text(((left + right) / 2, 735.0), titles[1], "ms")
    for tick in _ticks(highest):
        drawing.line([(left, down(tick)), (right, down(tick))], "#e0e0e0", 1)
        drawing.text((left - 10, down(tick)), f"{tick:.4g}", "rm")
    for tick in _ticks(float(sizes[-1])):
        drawing.line([(across(tick), bottom), (across(tick), bottom + 6)], "black", 1)
        drawing.text((across(tick), bottom + 12), f"{tick:.0f}", "mt")
    for side in ([(left, top), (left, bottom)], [(left, bottom), (right, bottom)]):
        drawing.line(side, "black", 1)
    for y in np.arange(top, bottom, 2 * _DASH):
        drawing.line([(across(knee), y), (across(knee), min(y + _DASH, bottom))], "black", 2)
    for (_, values), color in zip(curves.items(), _CURVE_COLORS, strict=False):
        points = [(across(size), down(value)) for size, value in zip(sizes, values, strict=True)]
        drawing.line(points, color, 3)
        drawing.dots(points, color)
    legend = [(name, color, 0) for name, color in zip(curves, _CURVE_COLORS, strict=False)]
    legend += [(f"knee, {knee:.3g} {unit}" if knee < 1000 else f"knee, {knee:.0f} {unit}", "black", _DASH)]
    for number, (name, color, dash) in enumerate(legend):
        y = top + 24 + 28 * number
        for x in np.arange(860.0, 900.0, 2 * dash or 40):
            drawing.line([(x, y), (min(x + (dash or 40), 900.0), y)], color, 2 if dash else 3)
        if not dash:
            drawing.dots([(880.0, y)], color)
        drawing.text((912.0, y), name, "lm")
    levels = np.asarray(made.reduce(_SCALE))
    return Image(linear_from_srgb(levels / 255).astype(np.float32), ("R", "G", "B"))


class _Drawing:
    """Lines, dots and text in pixels of a picture that is drawn larger and then reduced."""

    def __init__(self, drawn: "ImageDraw") -> None:
        from PIL import ImageFont

        self.drawn = drawn
        self.font = ImageFont.load_default(20 * _SCALE)

    def line(self, points: Sequence[tuple[float, float]], color: str, width: int) -> None:
        self.drawn.line([(x * _SCALE, y * _SCALE) for x, y in points], color, width * _SCALE, joint="curve")

    def dots(self, points: Sequence[tuple[float, float]], color: str) -> None:
        for x, y in points:
            self.drawn.circle((x * _SCALE, y * _SCALE), 6 * _SCALE, color)

    def text(self, place: tuple[float, float], text: str, anchor: str) -> None:
        """Black text; ``anchor`` as Pillow has it."""
        self.drawn.text((place[0] * _SCALE, place[1] * _SCALE), text, "black", self.font, anchor)
