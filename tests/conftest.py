"""Settings for all tests."""

import os

# Before numpy is imported: the matrices are small, and threads of BLAS would wait for each other on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import settings

# The same examples in every run, and no deadline: the first call of a kernel compiles it.
settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")
