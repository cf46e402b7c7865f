# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Steering by joystick and keyboard: the node, the mapping of buttons, the enable button."""
