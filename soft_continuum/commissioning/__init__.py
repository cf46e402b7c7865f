# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Bringing a rig into service: doctor and calibrate."""
