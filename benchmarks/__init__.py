"""What this project measures of itself and of others, and the pages that it writes in docs/:
python -m benchmarks.SUBJECT.NAME, each on one thread."""

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"  # in time: this package is imported before NumPy
