"""The actions, in Tools > Scripts > Texloom."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from PyQt5.QtWidgets import QApplication, QMessageBox, QWidget

from krita import Extension, Krita, Window

from . import dialogs, layers, session, tasks
from .dialogs import Field
from .running import Progress, begin
from .texloom_client import TexloomError

_MENU = "tools/scripts/texloom"


def _make_tileable() -> dict[str, Field]:
    return {
        "axes": dialogs.choice("Repeats", dialogs.AXES),
        "keep_size": dialogs.check("Keep the size"),
        "preset": dialogs.preset(),
        "seed": dialogs.seed(),
    }


def _larger() -> dict[str, Field]:
    of = layers.document()
    area = layers.read_area(of, layers.active(of), layers.selection(of))
    return {
        "width": dialogs.side("Width", 2 * area.width()),
        "height": dialogs.side("Height", 2 * area.height()),
        "tileable": dialogs.choice("Tileable", dialogs.TILEABLE),
        "method": dialogs.method(),
        "preset": dialogs.preset(),
        "new_picture": dialogs.check("As a new picture"),
        "seed": dialogs.seed(),
    }


def _fill() -> dict[str, Field]:
    return {"preset": dialogs.preset(), "seed": dialogs.seed()}


def _revise() -> dict[str, Field]:
    of = layers.document()
    own = layers.active(of).uniqueId()
    others = [node for node in layers.layers(of) if node.uniqueId() != own]
    if not others:
        raise TexloomError("there is no other layer that the selection could look like; add the exemplar as one")
    return {
        "exemplar": dialogs.choice("Like", [(node.uniqueId().toString(), node.name()) for node in others]),
        "tileable": dialogs.choice("Tileable", dialogs.TILEABLE),
        "preset": dialogs.preset(),
        "seed": dialogs.seed(),
    }


Fields = Callable[[], "dict[str, Field]"]
ACTIONS: dict[str, tuple[str, Fields, Callable[..., tasks.Task]]] = {
    "make_tileable": ("Make Tileable", _make_tileable, tasks.make_tileable),
    "larger": ("Larger Texture", _larger, tasks.larger),
    "fill": ("Fill Selection", _fill, tasks.fill),
    "revise": ("Revise Selection", _revise, tasks.revise),
}
_KEPT = ("axes", "keep_size", "tileable", "method", "preset", "new_picture", "seed")


def run(name: str, **values: Any) -> Progress:
    """Begin an action with these options; the window that shows how far it is."""
    return begin(ACTIONS[name][2](**values))


class Texloom(Extension):
    """What Krita calls."""

    def setup(self) -> None:
        QApplication.instance().aboutToQuit.connect(session.JOBS.close)

    def createActions(self, window: Window) -> None:  # noqa: N802
        for name, (label, _, _) in ACTIONS.items():
            action = window.createAction(f"texloom_{name}", f"{label}...", _MENU)
            action.triggered.connect(partial(self._asked, name))
        action = window.createAction("texloom_settings", "Settings...", _MENU)
        action.triggered.connect(self._settings)

    def _asked(self, name: str, _: bool = False) -> None:
        """Ask for the options, and begin."""
        label, fields, _ = ACTIONS[name]
        try:
            values = dialogs.ask(label, fields(), _parent(), _KEPT)
            if values is not None:
                run(name, **values)
        except TexloomError as error:
            QMessageBox.warning(_parent(), f"Texloom: {label}", str(error))

    def _settings(self, _: bool = False) -> None:
        """Where texloom and its results are."""
        hints = ("empty: TEXLOOM, the PATH, or uv tool", "empty: texloom's own folder")
        labels = ("Program", "Folder of results")
        fields = {}
        for name, label, hint in zip(session.SETTINGS, labels, hints):
            fields[name] = dialogs.text(label, hint)
            fields[name].write(session.setting(name))
        values = dialogs.ask("Settings", fields, _parent())
        if values is not None:
            session.change(values)


def _parent() -> QWidget | None:
    window = Krita.instance().activeWindow()
    return window.qwindow() if window is not None else None
