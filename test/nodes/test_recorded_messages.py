# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of three shapes say what they said when they were recorded (test/recorded/README.md)."""

import json

import pytest

from recorded.comparing import worst
from recorded.record_messages import MESSAGES, Run, RUNS


@pytest.mark.parametrize('name', RUNS)
def test_a_run_of_three_shapes_says_what_it_said(rig, name):
    recorded = json.loads((MESSAGES / f'{name}.json').read_text(encoding='utf-8'))
    off = worst(recorded, Run(rig, name).record())
    assert not off, '\n'.join(off)
