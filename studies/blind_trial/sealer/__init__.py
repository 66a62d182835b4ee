"""Makes sealed cases with a simulator of its own: nothing of models, design or diagnosis is imported here."""

import os

# Before numpy is imported: the matrices are small, and sums keep their order whatever the computer's cores.
for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
