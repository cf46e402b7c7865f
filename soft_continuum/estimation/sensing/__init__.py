# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shape sensing: poses of discs with covariance, from tags and cameras, trackers and IMUs."""
