# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the description of an arm from a few answers, and estimates the rest."""
