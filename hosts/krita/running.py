"""A window that shows how far a job is, with a preview; nothing waits for it."""

from __future__ import annotations

from PyQt5.QtCore import Qt, QTimer
from PyQt5.QtGui import QIcon, QImage, QPixmap
from PyQt5.QtWidgets import QDialog, QDialogButtonBox, QLabel, QProgressBar, QVBoxLayout, QWidget

from krita import Krita

from .controller import Job, Step, step
from .session import JOBS
from .tasks import Task
from .texloom_client import Pixels

_PAUSE = 200  # ms between looks
_SHOWN = 4000  # ms that a line floats over the picture
_STEPS = 1000  # of the bar
_SIDE = 256  # px of a preview
_WIDTH = 360  # px, at least
_OPEN: list[Progress] = []  # as Python forgets windows that only Qt holds


class Progress(QDialog):
    """One job. It closes when that is done, and stays where there is something to read."""

    def __init__(self, task: Task, parent: QWidget | None):
        super().__init__(parent)
        self.setWindowTitle(f"Texloom: {task.title}")
        self.setAttribute(Qt.WA_DeleteOnClose)
        self._task, self._seen = task, None
        self.job: Job = JOBS.begin(task.title, task.requests)
        self.ended: Step | None = None
        self._text, self._bar, self._preview = QLabel(self.job.progress.text), QProgressBar(), QLabel()
        self._text.setWordWrap(True)
        self._text.setTextFormat(Qt.PlainText)
        self._bar.setRange(0, _STEPS)
        self._buttons = QDialogButtonBox(QDialogButtonBox.Cancel)
        self._buttons.rejected.connect(self.reject)
        self.setMinimumWidth(_WIDTH)
        layout = QVBoxLayout(self)
        for part in (self._preview, self._text, self._bar, self._buttons):
            layout.addWidget(part)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._timer.start(_PAUSE)

    def reject(self) -> None:
        """Cancel the job, or close the window of one that has ended."""
        if self.ended is None:
            self.job.cancel()
            self._look()
        else:
            super().reject()

    def _look(self) -> None:
        if self.ended is not None:
            return
        now = step(self.job, self._task.apply)
        self._bar.setValue(int(_STEPS * self.job.progress.share))
        self._text.setText(now.text)
        self._show(self.job.preview())
        if now.state != "running":
            self._end(now)

    def _show(self, made: Pixels | None) -> None:
        if made is None or made is self._seen:
            return
        self._seen = made
        height, width = made.shape[:2]
        image = QImage(made.data, width, height, 4 * width, QImage.Format_RGBA8888).copy()
        self._preview.setPixmap(
            QPixmap.fromImage(image).scaled(_SIDE, _SIDE, Qt.KeepAspectRatio, Qt.SmoothTransformation)
        )

    def _end(self, now: Step) -> None:
        self.ended = now
        self._timer.stop()
        JOBS.end(self.job)
        notes = [*self._task.notes, *self.job.notes]
        if now.state == "failed" or (now.state == "finished" and notes):
            self._text.setText("\n".join([now.text, *notes]))
            self._buttons.setStandardButtons(QDialogButtonBox.Close)
            return
        tell(now.text)
        self.accept()


def tell(text: str) -> None:
    """A line over the picture, for some seconds."""
    window = Krita.instance().activeWindow()
    view = window.activeView() if window is not None else None
    if view is not None:
        view.showFloatingMessage(text, QIcon(), _SHOWN, 1)


def begin(task: Task) -> Progress:
    """Run a task; its window."""
    window = Krita.instance().activeWindow()
    progress = Progress(task, window.qwindow() if window is not None else None)
    _OPEN.append(progress)
    progress.finished.connect(lambda _: _OPEN.remove(progress))
    progress.show()
    return progress
