# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The examples of the page about mechanics run, one after the other."""

from pathlib import Path
import re

PAGE = Path(__file__).parents[2] / 'docs' / 'explanation' / 'mechanics.md'


def test_the_examples_of_the_page_run():
    blocks = re.findall(r'```python\n(.*?)```', PAGE.read_text(encoding='utf-8'), re.DOTALL)
    assert len(blocks) == 2
    names = {}
    for block in blocks:
        exec(compile(block, str(PAGE), 'exec'), names)
    assert names['tip'].reached
    assert abs(names['shape'].tip - (0.12, 0.05, 0.2)).max() < 1e-6
    assert names['path'].found.all()
