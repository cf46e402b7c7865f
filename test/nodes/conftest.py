# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The rigs of nodes."""

from support.rig_fixtures import (
    _compiled,
    _patient,
    arm,
    domain,
    make_rig,
    module_domain,
    module_rig,
    processes,
    rig,
    shared_arm,
    take_domain,
)
