"""Templates of texts that lie beside the stage that fills them in: shaders, documents, tile sets."""

from pathlib import Path
from typing import Any

_XML = ("mtlx.j2", "tsx.j2")


def templates(folder: Path) -> Any:
    """The templates in a folder, a `jinja2.Environment`; values are escaped where the text is XML."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=jinja2.select_autoescape(_XML),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
