"""`python -m tests.benchmark`, and a test of it."""

import os

# Before numpy is imported. Every matrix here is small: threads of BLAS would only spin, which counts as processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
