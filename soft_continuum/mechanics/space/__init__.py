# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Any arm in space: links and any tendons; what is compiled for them, and what calls it."""
