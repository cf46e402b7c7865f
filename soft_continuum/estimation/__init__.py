# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The shape and what is not known of the arm, from the statics and measurements.  No ROS."""
