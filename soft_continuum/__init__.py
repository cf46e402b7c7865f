# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Model, actuate and sequence variable-stiffness continuum arms, in a plane or in space."""


def version() -> str:
    """Return the version that is installed."""
    from importlib.metadata import PackageNotFoundError, version
    try:
        return version('soft_continuum')
    except PackageNotFoundError:
        return '(not installed, so of unknown version)'
