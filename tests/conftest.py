"""One BLAS thread, set before NumPy is imported: small matrices gain nothing from two, and processes share cores."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
