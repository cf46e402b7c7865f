# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The state machines that run plans, with and without measurements; the servo; without ROS."""
