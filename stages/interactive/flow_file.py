"""Files that sessions write: flows and geometry, as YAML of plain values."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_PLAIN_TEXT = re.compile(r"(?!(?:true|false|null|yes|no|on|off|y|n)$)[a-z][\w./-]*", re.IGNORECASE)


def flow_text(file: Path, include: str, sources: Mapping[str, str], params: Mapping[str, Mapping[str, Any]]) -> str:
    """A flow that is another one with these sources and these params of its steps.

    Parameters
    ----------
    file : where it will be written; the flow gets its name.
    """
    name = re.sub(r"\W+", "_", file.stem.lower(), flags=re.ASCII).strip("_") or "flow"
    lines = [f"flow: {name if name[0].isalpha() else 'flow_' + name}", f"include: {include}", "sources:"]
    lines += [f"  {source}: {yaml_value(reference)}" for source, reference in sources.items()]
    lines.append("steps:")
    lines += [f"  {step}: {yaml_value({'params': dict(values)})}" for step, values in params.items()]
    return "\n".join(lines) + "\n"


def yaml_value(value: Any) -> str:
    """A mapping, list, text, number or null on one line; numbers keep their bits."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{yaml_value(key)}: {yaml_value(part)}' for key, part in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(yaml_value, value))}]"
    if isinstance(value, float) and "." not in (text := repr(float(value))):
        return text.replace("e", ".0e")  # YAML takes 1e-05 for a text
    if isinstance(value, str):
        return value if _PLAIN_TEXT.fullmatch(value) else json.dumps(value, ensure_ascii=False)
    return json.dumps(value)
