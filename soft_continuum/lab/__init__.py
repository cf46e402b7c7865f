# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""From measurements and recordings to parameters, reports and designs of arms."""
