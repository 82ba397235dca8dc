"""How stages are run: flows, the artifact store, runners, the command line. Knows nothing of texture."""

import os

# Products of matrices come out with other last bits on another number of BLAS's own threads, which follows from the
# machine. To be said before NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
