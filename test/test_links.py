# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Every link between the pages leads somewhere."""

from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md'), *ROOT.glob('msg_docs/*.md')]
FENCE = re.compile(r'^ *```.*?^ *```', re.MULTILINE | re.DOTALL)
LINK = re.compile(r'\]\(([^)\s]+)\)')
HEADING = re.compile(r'^#+ (.+)$', re.MULTILINE)


def prose(page):
    """Return a page without its blocks of code."""
    return FENCE.sub('', page.read_text(encoding='utf-8'))


def anchors(page):
    """Return the anchors of the headings of a page, as GitHub and MyST make them."""
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-')
            for heading in HEADING.findall(prose(page))}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_links_of_a_page_lead_somewhere(page):
    for link in LINK.findall(prose(page)):
        if link.startswith(('http:', 'https:', 'mailto:')):
            continue
        path, _, anchor = link.partition('#')
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), link
        if anchor:
            assert anchor in anchors(there), link
