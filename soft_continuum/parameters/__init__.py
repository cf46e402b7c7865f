# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What a parameter is, the parameters of an arm and its shapes, parameter files and options.

``parameter`` says what a parameter is; ``arm`` and ``shapes`` list those of the arm.  ``files``
reads and writes ROS 2 parameter files, with ``overrides`` (which values a node gets) and
``scalars`` (how a value is written).  ``arguments`` has the options and questions of the verbs.
ros/parameter_table.py lists the parameters of every node, and drivers declare theirs in
``PARAMETERS``.
"""
