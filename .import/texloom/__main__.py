"""``python -m texloom``."""

from texloom.pipelines.cli.main import main

main()
