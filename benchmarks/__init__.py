# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of the mechanics: ``./run bench`` writes docs/explanation/performance.md and docs/explanation/accuracy.md."""

import os

# Small systems only: more threads would spin for nothing.  To be set before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
