"""The plug-in for Krita, imported and run in Krita on a virtual display: actions, depths, undo, cancel.

python in_krita.py ARCHIVE FOLDER, with krita and Xvfb on the PATH, and TEXLOOM set
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

SCENARIO = Path(__file__).with_name("krita_scenario.py")
PATIENCE = 900  # seconds; on two busy cores all takes over 300
SYSTEM = "/usr/bin:/bin"  # Krita's Python takes its libraries from beside the first python3 on the PATH
PROBE = """[Desktop Entry]
Type=Service
ServiceTypes=Krita/PythonPlugin
X-KDE-Library=scenario
Name=Scenario
Comment=Runs the plug-in
"""


def prepare(archive: Path, home: Path) -> dict[str, str]:
    """A home with the plug-in in it, where Krita's own importer puts it, and with what drives it."""
    resources = home / "data" / "krita"
    modules = resources / "pykrita"
    modules.mkdir(parents=True)
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(modules)
    (resources / "actions").mkdir()
    (modules / "texloom.action").rename(resources / "actions" / "texloom.action")
    (modules / "scenario").mkdir()
    shutil.copy(SCENARIO, modules / "scenario" / "__init__.py")
    (modules / "scenario.desktop").write_text(PROBE)
    (home / "config").mkdir()
    (home / "config" / "kritarc").write_text("[python]\nenable_texloom=true\nenable_scenario=true\n")
    places = {"HOME": home, "XDG_DATA_HOME": home / "data", "XDG_CONFIG_HOME": home / "config"}
    own = {name: str(path) for name, path in places.items()}
    own |= {"XDG_CACHE_HOME": str(home / "cache"), "TEXLOOM_STORE": str(home / "store")}
    return {**os.environ, **own, "PATH": SYSTEM}


def main(archive: Path, folder: Path) -> int:
    home = Path(tempfile.mkdtemp(dir=folder))
    told = home / "told.txt"
    environment = {**prepare(archive, home), "SCENARIO_TOLD": str(told)}
    reading, writing = os.pipe()
    screen = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1280x900x24"],
        pass_fds=(writing,), stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        display = os.read(reading, 16).decode().strip()
        with (home / "log.txt").open("w") as log:
            environment["DISPLAY"] = f":{display}"
            with contextlib.suppress(subprocess.TimeoutExpired):
                subprocess.run(
                    ["krita", "--nosplash"], env=environment, stdout=log, stderr=log, timeout=PATIENCE, check=False
                )
    finally:
        screen.terminate()
        screen.wait()
    text = told.read_text() if told.exists() else (home / "log.txt").read_text()[-2000:]
    print(text, end="")
    if text.rstrip().endswith("all passed"):
        return 0
    print(f"Krita: ended, or was ended after {PATIENCE} s, before all had passed")
    return 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()))
