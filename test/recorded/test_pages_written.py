# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pages and files that the suite generates are those that were recorded (README.md)."""

import re

from recorded.record_pages import PAGES, pages


def test_what_is_generated_is_what_it_was():
    found = dict(pages())
    assert sorted(found) == sorted(path.name for path in PAGES.iterdir())
    for name, text in found.items():
        assert facts(text) == facts((PAGES / name).read_text(encoding='utf-8')), name
        assert not re.search(r'\|\s*\|$', text, re.MULTILINE), f'{name}: no description'


def facts(text: str) -> list[str]:
    """Return the lines of a page, without the descriptions of parameters: these are words."""
    return [line.rsplit(' | ', line.count(' | ') - 5)[0] if line.startswith('| `') else line
            for line in text.splitlines()]
