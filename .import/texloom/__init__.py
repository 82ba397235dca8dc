"""Example-based texture synthesis: published methods as cached stages, joined by flows."""

from pathlib import Path

# A clone without symbolic links has text files in place of the links to the repository's folders.
if not (Path(__file__).parent / "stages").is_dir():
    __path__.append(str(Path(__file__).parents[2]))
