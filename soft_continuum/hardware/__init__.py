# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendon motors and jamming valves: protocols, drivers and controllers; without ROS."""
