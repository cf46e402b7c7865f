# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The pages of the documentation hold together: links, contents, command lines, code."""

import ast
from importlib import import_module
import re
from textwrap import dedent

import pytest

from soft_continuum.ros.description import load_description
from support.documented_commands import blocks, Checker, is_ros2, LINES, NOT_OURS, PAGES, ROOT

FENCE = re.compile(r'^ *```.*?^ *```', re.MULTILINE | re.DOTALL)
LINK = re.compile(r'\]\(([^)\s]+)\)')
HEADING = re.compile(r'^#+ (.+)$', re.MULTILINE)
LANGUAGES = ('', 'sh', 'text', 'json', 'yaml', 'python', 'math', 'mermaid', '{toctree}')
GENERATED = re.compile(r'<!-- (?:bench|table).*?<!-- end.*?-->', re.DOTALL)
UNUSUAL = re.compile(r"""
    (?i:\b(?:shall|anew|mended|askew|by[ ](?:it|them)sel(?:f|ves)|by[ ]how[ ]much|how[ ]near
        |arms?[ ]in[ ]space|so[ ](?:does|do|is|are)|nor[ ](?:does|do|is|are))\b)
    | (?:^|[.:][ ])Of[ ](?:an?|the|each|every|those|several)\b[^.,]*,
    """, re.VERBOSE | re.MULTILINE)
"""English that is not that of ROS 2's documents: see CONTRIBUTING.md."""
CALLS = re.compile(r'(\./run|soft_continuum|ros2|python|colcon) ')


def prose(page):
    """Return a page without its blocks of code."""
    return FENCE.sub('', page.read_text(encoding='utf-8'))


def anchors(page):
    """Return the anchors of the headings of a page, as GitHub and MyST make them."""
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-')
            for heading in HEADING.findall(prose(page))}


@pytest.mark.parametrize('page', PAGES)
def test_the_links_of_a_page_lead_somewhere(page):
    for link in LINK.findall(prose(PAGES[page])):
        if link.startswith(('http:', 'https:', 'mailto:')):
            continue
        path, _, anchor = link.partition('#')
        target = (PAGES[page].parent / path).resolve() if path else PAGES[page]
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link


def test_the_contents_list_every_page_once():
    index = ROOT / 'docs' / 'index.md'
    listed = [(index.parent / line).with_suffix('.md').resolve()
              for language, text in blocks(index) if language == '{toctree}'
              for line in text.splitlines() if line and not line.startswith(':')]
    pages = {path for name, path in PAGES.items() if '/' in name} - {index}
    assert sorted(listed) == sorted(pages)


@pytest.mark.parametrize('page', PAGES)
def test_a_page_is_in_plain_english(page):
    text = re.sub('`[^`]*`', '', GENERATED.sub('', prose(PAGES[page])))
    assert not UNUSUAL.findall(text)


def test_texts_in_the_code_are_in_plain_english():
    for path in (ROOT / 'soft_continuum').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                text = ' '.join(node.value.split())
                assert not UNUSUAL.findall(text), f'{path.name}:{node.lineno}: {text[:200]}'


@pytest.mark.parametrize('page', LINES)
def test_every_line_of_a_page_fits_its_verb(page):
    checker = Checker()
    for line in LINES[page]:
        if not is_ros2(line):
            try:
                checker.check(line)
            except AssertionError as error:
                pytest.fail(f'{line}: {error}')


@pytest.mark.parametrize('page', PAGES)
def test_a_block_of_a_page_is_what_its_language_says(page, tmp_path):
    for language, text in blocks(PAGES[page]):
        assert language in LANGUAGES
        if language != 'sh':
            assert not any(CALLS.match(line) for line in text.splitlines()), f'not in sh: {text}'
        if language == 'python':
            for node in ast.walk(ast.parse(dedent(text))):
                if isinstance(node, ast.ImportFrom):
                    assert {alias.name for alias in node.names} <= set(
                        dir(import_module(node.module or ''))), ast.unparse(node)
        if language == 'yaml' and text.startswith('/**:'):
            (tmp_path / 'file.yaml').write_text(text, encoding='utf-8')
            load_description(tmp_path / 'file.yaml')


def test_lines_of_other_programs_are_still_in_the_pages():
    lines = {line for page in LINES.values() for line in page}
    assert not NOT_OURS - lines
