# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""
Defects that are known and open: claims that do not hold yet.

Each is expected to fail and strictly so: the run fails when one begins to hold, and its line goes.
"""

from pathlib import Path

import pytest

KNOWN_DEFECTS = Path(__file__).with_name('known_defects.txt')


def pytest_collection_modifyitems(items):
    defects = set(KNOWN_DEFECTS.read_text(encoding='utf-8').splitlines())
    for item in items:
        if item.path.parent == KNOWN_DEFECTS.parent and (
                item.nodeid.rpartition('mechanics_extended/')[2] in defects):
            item.add_marker(pytest.mark.xfail(strict=True, reason='known defect'))
