# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pages and files that the suite generates are those that were recorded (README.md)."""

import re

from recorded.record_pages import PAGES, pages


def test_what_is_generated_is_what_it_was():
    found = dict(pages())
    assert sorted(found) == sorted(path.name for path in PAGES.iterdir())
    for name, text in found.items():
        was, now = facts((PAGES / name).read_text(encoding='utf-8')), facts(text)
        if name.startswith('parameters_') or name.endswith('_policy.xml'):
            assert not gone(was, now), name  # parameters and interfaces may be added
        else:
            assert now == was, name
        assert not re.search(r'\|\s*\|$', text, re.MULTILINE), f'{name}: no description'


def facts(text: str) -> list[str]:
    """Return the lines of a page, without the descriptions of parameters: these are words."""
    return [line.rsplit(' | ', line.count(' | ') - 5)[0] if line.startswith('| `') else line
            for line in text.splitlines()]


def gone(was: list[str], now: list[str]) -> list[str]:
    """Return the lines from the first on that is not there any more, in its order."""
    rest = iter(now)
    return [line for line in was if line not in rest]
