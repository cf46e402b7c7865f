# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks: ``./run bench`` writes their tables into the pages of docs."""

import os
from pathlib import Path
import sys

# Small systems only: more threads would spin for nothing.  To be set before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
sys.path.append(str(Path(__file__).parents[1] / 'test'))  # references, which check the solver
