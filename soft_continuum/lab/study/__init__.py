# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Design studies: reach, holding and planning of arms with different descriptions.

``design`` reads the variations, ``running`` computes units on one machine or a cluster and stores
their results, ``summary`` has the verb with its tables and figures.  No ROS.  The cluster is
Dask's (extra ``study``), loaded when used.
"""
