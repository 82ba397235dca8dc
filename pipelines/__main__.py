"""``python -m pipelines`` is ``texloom``."""

from pipelines.cli import main

main()
