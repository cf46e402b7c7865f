# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Design studies: how well arms that differ in their descriptions reach, hold and plan.

``design`` reads what is varied, ``sampling`` computes one unit of work, ``running`` has units
computed on one machine or a cluster and keeps what they give, ``summary`` makes tables and figures
of it.  No ROS.  The cluster is Dask's (extra ``study``), loaded when used.
"""
