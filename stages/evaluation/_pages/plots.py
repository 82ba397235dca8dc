"""Plots: SVG that takes the font and text colour of the page around, or pictures."""

import html
import io
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from texloom.stages.evaluation._pages.text import writable
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb

_INK = "#010203"  # placeholder for the text colour of the page
_BLUE, _ORANGE, _PURPLE = "#0072b2", "#e69f00", "#cc79a7"  # Okabe and Ito's, for colour-blind eyes too
_SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "texloom",  # otherwise names inside the file are random
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.size": 9,
    "text.color": _INK,
    "axes.edgecolor": _INK,
    "axes.labelcolor": _INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "grid.color": _INK,
    "grid.alpha": 0.15,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
}
_WIDTH, _HEIGHT = 480, 278  # px, of a panel of bars
_STEPS = np.array([1, 2, 5, 10, 20, 50])  # between ticks, times a power of ten
_MOST_TICKS = 5
_MAX_LABEL = 28  # characters; more leave no room for the plot
_drawing = threading.Lock()  # matplotlib's settings belong to the process


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
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * _WIDTH} {_HEIGHT}" width="{2 * _WIDTH}" '
        f'font-size="12" fill="currentColor">{panels[0]}<g transform="translate({_WIDTH})">{panels[1]}</g></svg>'
    )


def _bars(title: str, labels: Sequence[str], parts: Mapping[str, tuple[np.ndarray, str]]) -> str:
    """A panel of bars, each the sum of its ``parts``: name to values and colour.

    Written here, as importing matplotlib for it takes as long as all else of a page.
    """
    left, right, top, bottom = 44, _WIDTH - 16, 28, _HEIGHT - 62
    highest = max(float(np.nan_to_num(sum(values for values, _ in parts.values())).max()), 0.0) or 1.0
    step = next(step for step in _STEPS * 10.0 ** np.floor(np.log10(highest) - 1) if highest <= _MOST_TICKS * step)
    unit = (bottom - top) / highest
    drawn = [f'<text x="{left}" y="14">{title}</text>']
    for tick in np.arange(0, highest + step / 2, step):
        if tick <= highest * 1.001:
            y = bottom - tick * unit
            drawn.append(f'<path d="M{left} {y:.1f}H{right}" stroke="currentColor" stroke-opacity=".15"/>')
            drawn.append(f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:.4g}</text>')
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
        turned = f"translate({left + (place + 0.5) * spacing + 4:.1f} {bottom + 14}) rotate(-35)"
        drawn.append(f'<text transform="{turned}" text-anchor="end">{html.escape(writable(label))}</text>')
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
            paired[axis] = list(map(_label, by_method)), values
    if not paired:
        return ""

    def draw(figure: Any) -> None:
        panels = figure.subplots(1, len(paired), squeeze=False, sharey=True)[0]
        for panel, (axis, (methods, values)) in zip(panels, paired.items(), strict=True):
            places = np.arange(len(methods))
            panel.plot(places, values, color=_INK, linewidth=0.6, alpha=0.35)
            panel.plot(places, values.mean(axis=1), "o", color=_BLUE)
            panel.set_title(axis, loc="left")
            panel.set_xticks(places, methods, rotation=35, ha="right")
            panel.set_xlim(-0.5, len(methods) - 0.5)
            panel.set_ylim(-0.02, 1.02)
            panel.grid(axis="y")

    return _svg(draw, 10.0, 2.9)


def _label(text: str) -> str:
    return writable(text if len(text) <= _MAX_LABEL else text[: _MAX_LABEL - 1] + "…")


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


@contextmanager
def _figure(width: float, height: float, **options: Any) -> Iterator[Any]:
    """An empty figure, under the settings of all plots."""
    import matplotlib
    from matplotlib.figure import Figure

    with _drawing, matplotlib.rc_context(_SETTINGS):
        yield Figure((width, height), layout="constrained", **options)


def _svg(draw: Any, width: float, height: float) -> str:
    """What ``draw(figure)`` draws; sizes in inches."""
    buffer = io.StringIO()
    with _figure(width, height) as figure, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # the browser's fonts have it
        draw(figure)
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    return svg[svg.index("<svg") :].replace(_INK, "currentColor")


def size_curve(table: Mapping[str, Any]) -> Image:
    """Energy against compaction size as a picture; see `energy_curve` for the table."""
    rows, best = table["rows"], table["knee"]
    pixels = [row["pixels"] for row in rows]

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        for name, color in (("energy", _BLUE), ("inverse", _ORANGE), ("forward", _PURPLE)):
            axes.plot(pixels, [row[name] for row in rows], "o-", color=color, label=name)
        axes.axvline(best, color=_INK, linewidth=0.8, linestyle="--", label=f"knee, {best} px")
        if table["rule"] <= pixels[-1]:
            axes.axvline(table["rule"], color=_INK, linewidth=0.8, linestyle=":", label=f"rule, {table['rule']} px")
        axes.set_xlabel("size of the compaction, px")
        axes.set_title("energy, CIELAB units² per pixel", loc="left")
        axes.set_ylim(bottom=0)
        axes.legend()
        axes.grid(axis="y")

    return _picture(draw, 8.0, 5.0)


def _picture(draw: Any, width: float, height: float) -> Image:
    """What ``draw(figure)`` draws on white, 150 px an inch; sizes in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with _figure(width, height, dpi=150) as figure:
        canvas: Any = FigureCanvasAgg(figure)
        draw(figure)
        canvas.draw()
        levels = np.asarray(canvas.buffer_rgba())[..., :3]
    return Image(linear_from_srgb(levels / 255).astype(np.float32), ("R", "G", "B"))
