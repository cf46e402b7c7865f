# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Estimation of shape and parameters of the arm from statics and measurements.  No ROS."""
