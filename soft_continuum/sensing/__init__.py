# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the arm is seen to be: printed tags, a camera, and the poses of discs with covariance."""
