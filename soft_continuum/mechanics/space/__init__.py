# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Spatial arms: links and any tendons, with their compiled solver and its callers."""
