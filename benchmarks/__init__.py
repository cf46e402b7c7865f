# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks: ``./run bench`` writes performance.md and accuracy.md in docs/explanation."""

import os

# Small systems only: more threads would spin for nothing.  To be set before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
