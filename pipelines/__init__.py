"""How stages are run: flows, the artifact store, runners, the command line. Knows nothing of texture."""

import os

# BLAS and OpenCV give other last bits on another number of their own threads, which would be that of the machine.
# To be said before they are imported.
for name in ("OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ[name] = "1"
