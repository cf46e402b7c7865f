# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""From shapes and measurements to tables and figures; without ROS."""
