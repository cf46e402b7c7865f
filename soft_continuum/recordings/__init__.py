# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of everything that the nodes publish, as MCAP files that every tool of ROS opens."""
