# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests of the twin share."""

import pytest


@pytest.fixture(autouse=True)
def log_elsewhere(monkeypatch, tmp_path):
    """Keep the log that MuJoCo writes into the working directory out of the sources."""
    monkeypatch.chdir(tmp_path)
