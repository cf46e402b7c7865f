# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes, the plans that set them, and the state machine that runs a plan; without ROS."""
