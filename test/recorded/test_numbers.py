# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Twenty arms do what they did when their numbers were recorded (README.md)."""

import json

import pytest

from recorded.comparing import TIP_TOLERANCE, TOLERANCE, worst
from recorded.record_numbers import answers, names, NUMBERS, question


@pytest.mark.parametrize('name', names())
def test_an_arm_does_what_it_did(name):
    asked = question(name)
    recorded = json.loads((NUMBERS / f'{name}.json').read_text(encoding='utf-8'))
    found = answers(asked)
    off = [text for kind in recorded | found for text in worst(
        recorded.get(kind), found.get(kind),
        asked['search']['agree'] if kind == 'tip_plans' else
        TIP_TOLERANCE if kind == 'tips' else TOLERANCE)]
    assert not off, '\n'.join(off)
