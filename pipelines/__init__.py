"""How stages are run: flows, the artifact store, runners, the command line. Knows nothing of texture."""

import texloom.stages.libraries  # noqa: F401 (before numpy is imported: it limits the threads of numpy's BLAS)
