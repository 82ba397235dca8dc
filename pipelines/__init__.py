"""How stages are run: flows, the artifact store, runners, the command line. Knows nothing of texture."""

import texloom.stages.vocabulary.libraries  # noqa: F401 (before numpy is imported, to see whether its threads are limited)
