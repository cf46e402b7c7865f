# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tables and figures from shapes and measurements, with their verbs; without ROS."""
