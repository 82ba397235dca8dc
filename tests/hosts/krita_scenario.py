"""What `in_krita.py` runs inside Krita, as a plug-in. Krita's Python has no NumPy."""

from __future__ import annotations

import os
import random
import sys
import time
import traceback
from array import array
from collections.abc import Callable

from krita import Extension, Krita, Selection
from PyQt5.QtCore import QTimer
from PyQt5.QtWidgets import QApplication, QDialog, QDialogButtonBox, QLabel, QMessageBox

SIDE = 64
FAST = {"preset": "fast", "seed": 3}
SPACES = {
    "U8": ("RGBA", "sRGB-elle-V2-srgbtrc.icc"),
    "U16": ("RGBA", "sRGB-elle-V2-srgbtrc.icc"),
    "F16": ("RGBA", "sRGB-elle-V2-g10.icc"),
    "F32": ("RGBA", "sRGB-elle-V2-g10.icc"),
}
CODES = {"U8": ("B", 255), "U16": ("H", 65535), "F16": ("e", 1.0), "F32": ("f", 1.0)}
KRITA = Krita.instance()


def plugin(name: str) -> object:
    """A module of the plug-in."""
    __import__(f"texloom.{name}")
    return sys.modules[f"texloom.{name}"]


def exemplar(count: int, code: str, full: float) -> bytes:
    """Dots of which none is like another."""
    chance = random.Random(1)
    radii = [[3 + 4 * chance.random() for _ in range(4)] for _ in range(4)]
    values = []
    for row in range(SIDE):
        for column in range(SIDE):
            inside = (row % 16 - 8) ** 2 + (column % 16 - 8) ** 2 < radii[row // 16][column // 16] ** 2
            color = [0.3 + 0.4 * inside + 0.05 * chance.random() for _ in range(count - 1)]
            values += [*color, 1.0]
    if code in "BH":
        return array(code, [round(value * full) for value in values]).tobytes()
    import struct

    return struct.pack(f"<{len(values)}{code}", *values)


def picture(depth: str = "U8", model: str = "RGBA", profile: str = "") -> object:
    """A document whose one layer is an exemplar."""
    made = KRITA.createDocument(SIDE, SIDE, "exemplar", model, depth, profile or SPACES[depth][1], 72.0)
    KRITA.activeWindow().addView(made)
    count = 4 if model == "RGBA" else 2
    made.topLevelNodes()[0].setPixelData(exemplar(count, *CODES[depth]), 0, 0, SIDE, SIDE)
    made.refreshProjection()
    made.waitForDone()
    return made


def names(of: object) -> list[str]:
    return [
        node.name() for node in of.topLevelNodes() if node.type() == "paintlayer"
    ]  # a selection is a mask there


def until(done: Callable[[], bool], seconds: float = 120) -> None:
    """Let Krita go on until something is so."""
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, [job.progress for job in plugin("session").JOBS.running]
        QApplication.processEvents()
        time.sleep(0.005)


def run(name: str, **values: object) -> object:
    """An action with these options, once it has ended."""
    progress = plugin("extension").run(name, **{**FAST, **values})
    until(lambda: progress.ended is not None)
    return progress


def made(name: str, **values: object) -> str:
    progress = run(name, **values)
    assert progress.ended.state == "finished", progress.ended.text
    return progress.ended.text


def select(of: object, row: int, column: int, side: int) -> None:
    chosen = Selection()
    chosen.select(column, row, side, side, 255)
    of.setSelection(chosen)


def data(node: object, side: int = SIDE) -> bytes:
    return bytes(node.pixelData(0, 0, side, side))


def keep(window: object, name: str) -> None:
    """A picture of a window, to be looked at."""
    window.grab().save(os.path.join(os.path.dirname(os.environ["SCENARIO_TOLD"]), f"{name}.png"))  # noqa: PTH118, PTH120


def colors(node: object) -> set[bytes]:
    """The different pixels of a layer."""
    flat = data(node)
    step = len(flat) // SIDE**2
    return {flat[begin : begin + step] for begin in range(0, len(flat), step)}


# -- what is shown to work


def test_depths() -> None:
    """Results have the colours of the exemplar, bit for bit, in its depth."""
    for depth in SPACES:
        of = picture(depth)
        text = made("larger", width=SIDE, height=SIDE, tileable="off", method="quilting")
        base, new = of.topLevelNodes()
        assert text == f"Larger Texture: {base.name()} larger, 64x64 px", text
        assert (new.colorModel(), new.colorDepth(), new.colorProfile()) == ("RGBA", depth, of.colorProfile())
        assert data(new) != data(base)
        missed = colors(new) - colors(base)
        assert len(missed) < 0.02 * SIDE**2, (depth, len(missed))
        of.setModified(False)


def test_spaces() -> None:
    """Grey, and integers of linear light."""
    for depth, model, profile in (
        ("U8", "GRAYA", "Gray-D50-elle-V2-srgbtrc.icc"),
        ("U16", "RGBA", SPACES["F32"][1]),
    ):
        of = picture(depth, model, profile)
        made("larger", width=SIDE, height=SIDE, tileable="off", method="quilting")
        base, new = of.topLevelNodes()
        assert (new.colorModel(), new.colorDepth(), new.colorProfile()) == (model, depth, profile)
        assert len(colors(new) - colors(base)) < 0.02 * SIDE**2, (depth, model)


def test_undo_is_one_step() -> None:
    of = picture()
    before = data(of.topLevelNodes()[0])
    made("make_tileable", axes="both", keep_size=True)
    assert names(of)[1:] == [f"{names(of)[0]} tileable"], names(of)
    made("make_tileable", axes="x", keep_size=True)
    assert names(of)[1] == f"{names(of)[0]} tileable 2", names(of)  # just above the original, which stays chosen
    after = data(of.topLevelNodes()[1])
    KRITA.action("edit_undo").trigger()
    of.waitForDone()
    assert len(names(of)) == 2
    KRITA.action("edit_redo").trigger()
    of.waitForDone()
    assert len(names(of)) == 3
    for _ in range(2):
        KRITA.action("edit_undo").trigger()
        of.waitForDone()
    assert len(names(of)) == 1, names(of)
    assert data(of.topLevelNodes()[0]) == before
    assert after != before


def test_larger_than_the_canvas() -> None:
    of = picture()
    text = made("larger", width=80, height=96, tileable="both", method="quilting")
    assert text.endswith("80x96 px; Image > Trim to Current Layer shows all of it"), text
    assert (of.topLevelNodes()[1].bounds().width(), of.width()) == (80, SIDE)
    count = len(KRITA.documents())
    made("larger", width=80, height=96, tileable="off", method="quilting", new_picture=True)
    assert len(KRITA.documents()) == count + 1
    new = KRITA.documents()[-1]
    assert (new.width(), new.height(), new.colorDepth()) == (80, 96, "U8")
    assert data(new.topLevelNodes()[0]).count(255) < 80 * 96 * 2  # it is not the white one of new pictures


def test_what_is_selected() -> None:
    """Only what is selected is shown; elsewhere the new layer is empty."""
    of = picture()
    base = of.topLevelNodes()[0]
    select(of, 20, 24, 16)
    made("fill")
    new = data(of.topLevelNodes()[1])
    for row in range(SIDE):
        for column in range(SIDE):
            inside = 20 <= row < 36 and 24 <= column < 40
            assert new[4 * (row * SIDE + column) + 3] == (255 if inside else 0), (row, column)
    assert colors(of.topLevelNodes()[1]) - colors(base)
    of.setActiveNode(of.topLevelNodes()[0])
    like = of.createNode("like", "paintlayer")
    inverse = array("B", exemplar(4, "B", 255)).tobytes().translate(bytes(range(254, -1, -1)) + b"\xff")
    like.setPixelData(inverse, 0, 0, SIDE, SIDE)
    of.rootNode().addChildNode(like, None)
    of.setActiveNode(base)
    made("revise", exemplar=like.uniqueId().toString(), tileable="off")
    assert sorted(names(of))[-1] == "like"
    assert any(name.endswith("revised") for name in names(of))


def test_a_rectangle() -> None:
    of = picture()
    select(of, 8, 4, 48)
    made("larger", width=48, height=48, tileable="off", method="quilting")
    bounds = of.topLevelNodes()[1].bounds()
    assert (bounds.x(), bounds.y(), bounds.width(), bounds.height()) == (4, 8, 48, 48)


def test_cancel() -> None:
    of = picture()
    progress = plugin("extension").run(
        "larger", width=2048, height=2048, tileable="both", method="self_tuning", **FAST
    )
    until(lambda: progress.job.preview() is not None)
    until(lambda: progress._preview.pixmap() is not None)
    keep(progress, "progress")
    keep(KRITA.activeWindow().qwindow(), "krita")
    progress.reject()
    until(lambda: progress.ended is not None)
    assert progress.ended.state == "cancelled"
    assert len(names(of)) == 1, names(of)
    assert plugin("session").JOBS.running == []


def test_a_picture_that_is_closed() -> None:
    of = picture()
    progress = plugin("extension").run("larger", width=256, height=256, tileable="off", method="quilting", **FAST)
    of.setModified(False)
    of.close()
    until(lambda: progress.ended is not None)
    assert progress.ended == ("failed", "Larger Texture: the picture was closed meanwhile"), progress.ended
    assert progress.isVisible()  # it stays, to be read
    progress.reject()


def problem(name: str, **values: object) -> str:
    """Why an action is refused, or fails."""
    try:
        progress = run(name, **values)
    except plugin("texloom_client").TexloomError as error:
        return str(error)
    assert progress.ended.state == "failed", progress.ended
    progress.reject()
    return progress.ended.text


def test_problems() -> None:
    """Each is one line, and nothing is added."""
    of = picture()
    revision = {"exemplar": "none", "tileable": "off"}
    told = [problem("fill"), problem("revise", **revision)]
    told.append(problem("larger", width=0, height=64, tileable="off", method="quilting"))
    select(of, 0, 0, SIDE)
    told += [problem("fill"), problem("revise", **revision)]
    select(of, 0, 0, 16)
    told.append(problem("revise", **revision))
    for depth, model, profile in (("U8", "CMYKA", "Chemical proof"), ("F32", "RGBA", SPACES["U8"][1])):
        other = KRITA.createDocument(SIDE, SIDE, "other", model, depth, profile, 72.0)
        KRITA.activeWindow().addView(other)
        told.append(problem("make_tileable", axes="both", keep_size=True))
    wanted = [
        "nothing of the layer", "nothing of the layer", "size", "all of the layer", "all of the layer",
        "exemplar: choose the layer", "the layer is CMYKA of U8", "the layer has floats in the profile",
    ]  # fmt: skip
    for text, part in zip(told, wanted, strict=True):
        assert part in text, (part, text)
        assert "\n" not in text
    assert len(names(of)) == 1, names(of)


def test_dialogs() -> None:
    """As a person does: choose the action, press OK; and a problem in a box."""
    of = picture()
    seen = []

    def press() -> None:
        dialog = QApplication.activeModalWidget()
        seen.append(type(dialog).__name__)
        if isinstance(dialog, QMessageBox):
            seen.append(dialog.text())
            dialog.accept()
        else:
            seen.append([label.text().replace("&", "") for label in dialog.findChildren(QLabel)])
            keep(dialog, "options")
            dialog.findChild(QDialogButtonBox).button(QDialogButtonBox.Ok).click()

    QTimer.singleShot(500, press)
    KRITA.action("texloom_make_tileable").trigger()
    assert seen == ["QDialog", ["Repeats", "Keep the size", "Speed", "Seed"]], seen
    assert len(plugin("session").JOBS.running) == 1
    shown = [one for one in KRITA.activeWindow().qwindow().findChildren(QDialog) if hasattr(one, "ended")]
    until(lambda: not plugin("session").JOBS.running)
    assert shown
    assert len(names(of)) == 2, names(of)
    seen.clear()
    of.setSelection(None)
    QTimer.singleShot(500, press)
    QTimer.singleShot(1500, press)
    KRITA.action("texloom_fill").trigger()
    assert seen[2:] == ["QMessageBox", "nothing of the layer is selected; select what is to be made anew"], seen


TESTS = [one for name, one in list(globals().items()) if name.startswith("test_")]


class Scenario(Extension):
    def setup(self) -> None:
        pass

    def createActions(self, _: object) -> None:  # noqa: N802
        QTimer.singleShot(2000, self.go)

    def go(self) -> None:
        status = 1
        with open(os.environ["SCENARIO_TOLD"], "w", buffering=1) as told:  # noqa: PTH123
            try:
                print(f"Krita {KRITA.version()}, Python {sys.version.split()[0]}", file=told)
                for test in TESTS:
                    begin = time.monotonic()
                    test()
                    print(f"Krita: {test.__name__[5:]}: {time.monotonic() - begin:.1f} s", file=told)
                print("Krita: all passed", file=told)
                status = 0
            except BaseException:
                traceback.print_exc(file=told)
        plugin("session").JOBS.close()
        os._exit(status)  # Krita would ask whether to keep what has changed


KRITA.addExtension(Scenario(KRITA))
