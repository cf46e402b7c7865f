# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Every parameter of the suite, declared once with type, default, bounds, unit and meaning.

``parameter`` says what a parameter is; ``arm``, ``shapes`` and ``nodes`` list them; ``files``
reads ROS 2 parameter files; ``reference`` writes the tables in ``msg_docs/``.  Drivers declare
theirs in ``PARAMETERS``.
"""
