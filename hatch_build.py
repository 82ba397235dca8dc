"""Adds a software bill of materials to the wheel: what it holds, and what it needs (CycloneDX 1.6, PEP 770)."""

from __future__ import annotations

import json
import re
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FILE = "texloom.cdx.json"


class BillOfMaterials(BuildHookInterface):
    """The build hook of ``pyproject.toml``, whose ``licences`` are those of the direct dependencies."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the file, which the builder copies into the wheel."""
        if version == "editable":
            return
        self.folder = Path(tempfile.mkdtemp())
        path = self.folder / FILE
        path.write_text(json.dumps(bill(self.metadata.core, self.config["licences"]), indent=1) + "\n")
        build_data["sbom_files"].append(str(path))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove it."""
        if version != "editable":
            (self.folder / FILE).unlink()
            self.folder.rmdir()


def bill(core: Any, licences: dict[str, str]) -> dict[str, Any]:
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
