# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of the mechanics: ``./run bench`` writes docs/performance.md and docs/accuracy.md."""
