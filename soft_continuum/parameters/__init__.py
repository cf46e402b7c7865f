# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What a parameter is, the parameters of an arm and its shapes, and files of parameters.

``parameter`` says what a parameter is; ``arm`` and ``shapes`` list those of the arm; ``files``
reads ROS 2 parameter files.  ros/parameter_table.py lists those of every node, and drivers
declare theirs in ``PARAMETERS``.
"""
