# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Steering by joystick and keyboard: what their buttons mean, and when they may move an arm."""
