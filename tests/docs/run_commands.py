"""Run the commands that README and docs print, to their end, and check what they write.

    python -m tests.docs.run_commands                           all, which takes about an hour
    python -m tests.docs.run_commands --shell zsh README.md     those of a page
    python -m tests.docs.run_commands --match 'quilting|plan'   those that match

The commands of a page run in order, in a folder of their own, as printed. Two placeholders are replaced: the
network folder ``/data`` is a folder in there, and the machine ``head`` is this one. The pictures are small. Servers
are started where a page prints their commands or a command needs them, and ended with the page. What is not run is
listed with the reason.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import itertools
import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from PIL import Image

from tests.conftest import ROOT
from tests.docs.files import make_files
from tests.docs.pages import DOCS, PAGES, label, shell_lines
from texloom.pipelines.store import codec
from texloom.pipelines.store.store import Store

SHELLS = {"bash": ["bash", "-eu"], "zsh": ["zsh", "-feu"]}
PROGRAMS = {
    "texloom",
    "python",
    "python3",
    "pip",
    "dask",
    "prefect",
    "export",
    "check",
    "pre-commit",
    "sphinx-build",
}
"""what commands on pages begin with"""
SKIPPED = {
    r"-m venv|pip install|pytest": "installs or tests; CI does that",
    r"benchmarks\.": "for contributors; trains or measures",
    r"texloom studio": "serves until it is ended; tests/studio does that",
}
_SERVER = re.compile(r"(?:^|/)(?:dask (scheduler|worker)|prefect (server|worker) start)\b")
_PORTS = {"scheduler": 8786, "server": 4200}
_WAIT = 180  # s, for what a server does
_MOST = 3600  # s, for a command


class CommandError(Exception):
    """A command has failed, or has not written what it should."""


class Session:
    """The commands of a page, in a folder of their own."""

    def __init__(self, folder: Path, shell: str) -> None:
        self.folder = folder
        self.shell = SHELLS[shell]
        self.exports: list[str] = []
        self.servers: list[subprocess.Popen[bytes]] = []
        for link, target in {
            ".venv": sys.prefix,
            "data/venv": sys.prefix,
            "prefect.yaml": ROOT / "prefect.yaml",
        }.items():
            (folder / link).parent.mkdir(exist_ok=True)
            (folder / link).symlink_to(target)
        Store(folder / "artifacts").create()

    def run(self, line: str) -> str:
        """Run a line of a page, and check what it prints and writes; its output."""
        line = line.replace("/data/", f"{self.folder}/data/").replace("tcp://head:", "tcp://127.0.0.1:")
        if _SERVER.search(line):
            self.start(line)
            return ""
        if "--address" in line and not self.servers:
            for server in filter(_SERVER.search, shell_lines(DOCS / "cluster.md")):
                self.run(server)
        arguments = shlex.split(line, comments=True)
        if Path(arguments[0]).name == "texloom":
            make_files(arguments[1:], self.folder)
        done = subprocess.run(
            [*self.shell, "-c", "\n".join([*self.exports, line])],
            cwd=self.folder, env=self.environment(), stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=_MOST, check=False,
        )  # fmt: skip
        if done.returncode:
            raise CommandError(f"exit code {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
        self.check(arguments, done.stdout)
        return done.stdout

    def environment(self) -> dict[str, str]:
        """That of a user who has activated the environment, without settings."""
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "TEXLOOM_"))}
        path = f"{Path(sys.prefix) / 'bin'}{os.pathsep}{kept['PATH']}"
        return {**kept, "PATH": path, "PREFECT_HOME": str(self.folder / ".prefect")}

    def start(self, line: str) -> None:
        """Start a server or a worker, and wait until it can be reached."""
        with (self.folder / f"server_{len(self.servers)}.log").open("wb") as log:
            server = subprocess.Popen(
                [*self.shell, "-c", "\n".join([*self.exports, f"exec {line}"])],
                cwd=self.folder, env=self.environment(), stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                start_new_session=True,
            )  # fmt: skip
        self.servers.append(server)
        port = next((port for kind, port in _PORTS.items() if kind in line), None)
        until = time.monotonic() + _WAIT
        while time.monotonic() < until:
            if server.poll() is not None:
                raise CommandError(f"ended\n{Path(log.name).read_text()[-4000:]}")
            if port is None:
                time.sleep(5)  # a worker, whose runs wait for it
                return
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
                return
            time.sleep(0.5)
        raise CommandError(f"cannot be reached on port {port}")

    def end(self) -> None:
        """End the servers."""
        for server in reversed(self.servers):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(server.pid, signal.SIGTERM)
        for server in self.servers:
            try:
                server.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(server.pid, signal.SIGKILL)

    def check(self, arguments: Sequence[str], said: str) -> None:
        """A command of texloom has printed and written what it should."""
        options = dict(itertools.pairwise(arguments))
        written = [options[name] for name in ("--out", "--report", ">") if name in options]
        written += (
            re.findall(r"out=(\S+)", " ".join(arguments)) if arguments[:2] == ["prefect", "deployment"] else []
        )
        if arguments[1] in ("run", "compare") and not written:
            written = [line for line in said.splitlines() if (self.folder / line).exists()]
            if not written:
                raise CommandError(f"names nothing that it has written\n{said}")
        if "--report" in options:
            written += [str(Path(options["--report"]).with_suffix(suffix)) for suffix in (".csv", ".json")]
        for name in written:
            check_written(self.folder / name, _WAIT if arguments[0] == "prefect" else 0)
        if ">" not in options and arguments[0] != "prefect" and not said.strip():
            raise CommandError("prints nothing")


def check_written(path: Path, wait: float) -> None:
    """A file, or each of a folder, can be read; ``wait``: how long it may take until it is there, s."""
    until = time.monotonic() + wait
    while not path.exists() and time.monotonic() < until:
        time.sleep(1)
    files = [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]
    if not files:
        raise CommandError(f"{path}: not written")
    for file in files:
        if file.suffix == ".exr":
            codec.describe(file)
        elif file.suffix in (".png", ".jpg"):
            with Image.open(file) as picture:
                picture.load()
        elif file.suffix == ".json":
            json.loads(file.read_text())
        elif file.suffix == ".csv":
            with file.open(newline="") as opened:
                next(csv.reader(opened))
        elif not file.stat().st_size:
            raise CommandError(f"{file}: empty")


def parts_to_run(line: str) -> tuple[str, list[str]]:
    """What of a line is run, and why the rest is not."""
    kept, reasons = [], []
    for part in line.split(" && "):
        reason = next((reason for pattern, reason in SKIPPED.items() if re.search(pattern, part)), None)
        if reason is None:
            kept.append(part)
        else:
            reasons.append(f"{part}: {reason}")
    return " && ".join(kept), reasons


@contextlib.contextmanager
def session(folder: Path, shell: str) -> Iterator[Session]:
    """A page's session, whose servers are ended."""
    opened = Session(folder, shell)
    try:
        yield opened
    finally:
        opened.end()


def main() -> int:
    """Run what is asked for; the number of commands that failed."""
    pages = {label(page): page for page in PAGES if page.is_relative_to(DOCS) or page == ROOT / "README.md"}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="as docs/gallery.md; default: all")
    parser.add_argument("--shell", choices=SHELLS, default="bash")
    parser.add_argument("--match", default="", metavar="REGEX", help="only commands that match")
    options = parser.parse_args()
    failed = 0
    for name in options.pages or pages:
        lines = [line for line in shell_lines(pages[name]) if re.search(f"^export |{options.match}", line)]
        with tempfile.TemporaryDirectory() as folder, session(Path(folder).resolve(), options.shell) as opened:
            for line in lines:
                failed += not tried(opened, name, line)
    print(f"{failed} failed")
    return failed


def tried(opened: Session, name: str, line: str) -> bool:
    """Run a line and print how it went; whether it went well."""
    kept, reasons = parts_to_run(line)
    for reason in reasons:
        print(f"{name}  not run  {reason}", flush=True)
    if not kept:
        return True
    if line.startswith("export "):
        opened.exports.append(line)
        return True
    began = time.monotonic()
    try:
        opened.run(kept)
    except (CommandError, OSError, ValueError, subprocess.TimeoutExpired) as error:
        print(f"{name}  FAILED  {kept}\n{error}", flush=True)
        return False
    print(f"{name}  {time.monotonic() - began:.1f} s  {kept}", flush=True)
    return True


if __name__ == "__main__":
    sys.exit(bool(main()))
