# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""From a few numbers of an arm to its description: what is asked, what is estimated instead."""
