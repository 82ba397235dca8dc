"""Writes the table of `docs/platforms.md`: where the package index has wheels of all that texloom needs.

    python docs/resolve_platforms.py            # needs uv and the package index; takes a few minutes

uv resolves `pyproject.toml` for each platform and version of Python, as an installation there would, without
building anything. What it cannot resolve is named by the packages of which there is no wheel.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("platforms.md")
PLATFORMS = {
    "Linux, x86-64": "x86_64-manylinux_2_28",
    "Linux, ARM": "aarch64-manylinux_2_28",
    "Linux with musl, x86-64": "x86_64-unknown-linux-musl",
    "Linux with musl, ARM": "aarch64-unknown-linux-musl",
    "macOS, ARM": "aarch64-apple-darwin",
    "macOS, Intel": "x86_64-apple-darwin",
    "Windows, x86-64": "x86_64-pc-windows-msvc",
    "Windows, ARM": "aarch64-pc-windows-msvc",
}
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
_LACKING = re.compile(r"(?:Because|because|and) ([\w-]+)[^\s]* has no (?:usable )?wheels")
_TOLD = ("numba", "numpy", "opencv-contrib-python-headless")


def resolved(platform: str, version: str) -> str:
    """What of the libraries that decide is installed there, or which packages have no wheel."""
    command = [
        "uv", "pip", "compile", "--quiet", "--no-header", "--no-annotate", "--only-binary", ":all:",
        "--prerelease", "disallow", "--python-platform", platform, "--python-version", version, "pyproject.toml",
    ]  # fmt: skip
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)  # noqa: S603
    if ran.returncode:
        lacking = sorted(set(_LACKING.findall(ran.stderr)))
        if not lacking:
            sys.exit(f"{platform}, Python {version}: {ran.stderr.strip()}")
        return f"no wheels of {', '.join(lacking)}"
    pinned = dict(line.split("==") for line in ran.stdout.split() if "==" in line)
    return ", ".join(f"{name.partition('-')[0]} {pinned[name]}" for name in _TOLD)


def table() -> str:
    """The table, in which versions of Python that are alike share a row."""
    lines = ["| platform | Python | |", "|---|---|---|"]
    for name, platform in PLATFORMS.items():
        found: dict[str, list[str]] = {}
        for version in VERSIONS:
            found.setdefault(resolved(platform, version), []).append(version)
        lines += [f"| {name} | {', '.join(versions)} | {what} |" for what, versions in found.items()]
        print(*lines[-len(found) :], sep="\n", flush=True)
    return "\n".join(lines)


def main() -> None:
    """Replace the table."""
    if shutil.which("uv") is None:
        sys.exit("uv is needed")
    text = PAGE.read_text()
    new, count = re.subn(r"\| platform \| Python \| \|\n(?:\|.*\n)+", table() + "\n", text)
    if count != 1:
        sys.exit(f"{PAGE}: has no table of platforms")
    PAGE.write_text(new)


if __name__ == "__main__":
    main()
