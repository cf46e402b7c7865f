# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of all topics of the nodes, as MCAP files for the tools of ROS."""
