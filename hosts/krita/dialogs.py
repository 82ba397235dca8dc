"""The options of each action, which are kept from one time to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from PyQt5.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QLineEdit,
    QSpinBox,
    QWidget,
)

from .requests import METHODS, PRESETS

_MOST_PX = 16384
_MOST_SEED = 2**31 - 1
AXES = (("both", "both axes"), ("x", "left to right"), ("y", "top to bottom"))
TILEABLE = (("off", "no"), *AXES)


class Field:
    """A control with a label, and how its value is read."""

    def __init__(self, label: str, control: QWidget, read: Callable[[], Any], write: Callable[[Any], None]):
        self.label, self.control, self.read, self.write = label, control, read, write


def choice(label: str, options: Sequence[tuple[str, str]]) -> Field:
    """One of several values, shown by their labels."""
    box = QComboBox()
    for value, shown in options:
        box.addItem(shown, value)

    def write(value: Any) -> None:
        box.setCurrentIndex(max(0, box.findData(value)))

    return Field(label, box, box.currentData, write)


def number(label: str, low: int, high: int, value: int, unit: str = "") -> Field:
    box = QSpinBox()
    box.setRange(low, high)
    box.setSuffix(unit)
    box.setValue(value)
    return Field(label, box, box.value, box.setValue)


def check(label: str) -> Field:
    box = QCheckBox()
    return Field(label, box, box.isChecked, box.setChecked)


def text(label: str, hint: str) -> Field:
    line = QLineEdit()
    line.setPlaceholderText(hint)
    return Field(label, line, line.text, line.setText)


def seed() -> Field:
    return number("Seed", 0, _MOST_SEED, 0)


def preset() -> Field:
    return choice("Speed", [(one, "best" if one == "default" else one) for one in PRESETS])


def method() -> Field:
    return choice("Method", [(one, one.replace("_", " ")) for one in METHODS])


def side(label: str, value: int) -> Field:
    return number(label, 16, _MOST_PX, min(value, _MOST_PX), " px")


_KEPT: dict[str, dict[str, Any]] = {}


def ask(
    title: str, fields: dict[str, Field], parent: QWidget | None, kept: Sequence[str] = ()
) -> dict[str, Any] | None:
    """The values that a person confirms; None where it is cancelled. Those of ``kept`` are as they were last."""
    dialog = QDialog(parent)
    dialog.setWindowTitle(f"Texloom: {title}")
    layout = QFormLayout(dialog)
    for name, field in fields.items():
        if name in kept and name in _KEPT.get(title, {}):
            field.write(_KEPT[title][name])
        layout.addRow(field.label, field.control)
    buttons = QDialogButtonBox(QDialogButtonBox.Ok | QDialogButtonBox.Cancel)
    buttons.accepted.connect(dialog.accept)
    buttons.rejected.connect(dialog.reject)
    layout.addRow(buttons)
    if dialog.exec_() != QDialog.Accepted:
        return None
    _KEPT[title] = {name: field.read() for name, field in fields.items()}
    return dict(_KEPT[title])
