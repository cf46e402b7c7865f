# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Planar arms: hinges and a pair of tendons, with their compiled solver and its callers."""
