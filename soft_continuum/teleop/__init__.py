# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Steering by joystick and keyboard: their node, what buttons mean, when they move an arm."""
