# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Nothing of these tests needs a display or writes beside the tests' own directories."""

from pathlib import Path
import sys

import pytest

# The generator of the simulated specimen's data is a script beside them.
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'data' / 'simulated_specimen'))


@pytest.fixture(autouse=True)
def _in_a_directory_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
