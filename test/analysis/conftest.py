# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Nothing of these tests needs a display or writes beside the tests' own directories."""

import pytest


@pytest.fixture(autouse=True)
def _in_a_directory_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
