# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Answers the questions about 20 arms: in `test/`, `python -m recorded.record_numbers`.

It writes the answers that are not there, and never over those that are.
"""

from collections.abc import Mapping
import json
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from recorded.adapter import Model, Numbers

HERE = Path(__file__).resolve().parent
ARMS, NUMBERS = HERE / 'arms', HERE / 'numbers'
TIME_LIMIT = 600.0
"""s, of plans by tip: those that are asked for are found in a small part of it."""


def names() -> list[str]:
    """Return the names of the arms."""
    return sorted(path.stem for path in ARMS.glob('*.yaml'))


def question(name: str) -> dict[str, Any]:
    """Return what is asked of an arm."""
    found: dict[str, Any] = yaml.safe_load((ARMS / f'{name}.yaml').read_text(encoding='utf-8'))
    return found


def answers(asked: Mapping[str, Any], time_limit: float = TIME_LIMIT) -> Numbers:
    """Return the answers of today's code, as JSON has them."""
    model = Model(asked)
    found: Numbers = {'walk': _walk(model, asked['walk'])}
    for kind, answer in (
            ('set_shapes', lambda one: model.state(model.set_shape(
                _bending(one['bending']), one.get('order')))),
            ('pulls_for', lambda one: _pulls_for(model, one)),
            ('tips', lambda one: _tip(model, one)),
            ('arcs', lambda one: model.arcs(_bending(one))),
            ('plans', lambda one: model.plans(one, asked['limits'])),
            ('tip_plans', lambda one: model.tip_plan(
                one, asked['limits'], asked['search'], time_limit))):
        if kind in asked:
            found[kind] = [answer(one) for one in asked[kind]]
    plain = _plain(found)
    assert isinstance(plain, dict)
    return plain


def _walk(model: Model, steps: list[dict[str, Any]]) -> list[Numbers]:
    """Go from one equilibrium to the next."""
    state, found = model.straight(), []
    before: Any = None
    for step in steps:
        soft = [flag == 'soft' for flag in step['segments']]
        sliding = step.get('sliding', ())
        if 'tensions' in step:
            state = model.solve_tensions(state, soft, step['tensions'])
        elif 'bending' in step:
            state = model.bend(state, soft, _bending(step['bending']))
        else:
            pulls = np.array([-inf if pull == 'slack' else pull for pull in step['pulls']])
            for part in np.arange(1, step.get('in_steps', 1)) / step.get('in_steps', 1):
                there = pulls.copy()
                moves = np.isfinite(pulls)
                there[moves] = before[moves] + part * (pulls[moves] - before[moves])
                state = model.solve(state, soft, pulls=there, vacuum=step.get('vacuum'),
                                    sliding=sliding)
            state = model.solve(state, soft, pulls=pulls, vacuum=step.get('vacuum'),
                                sliding=sliding)
            before = pulls
        numbers = model.state(state, sliding)
        if step.get('derivatives'):
            numbers['derivatives'] = model.derivatives(state, sliding)
        found.append(numbers)
    return found


def _pulls_for(model: Model, asked: Mapping[str, Any]) -> Numbers:
    state, pulls = model.pulls_for(
        model.straight(), _bending(asked['bending']),
        [flag == 'soft' for flag in asked['segments']], asked['pretension'])
    return {'state': model.state(state), 'pulls': pulls}


def _tip(model: Model, position: list[float]) -> Numbers:
    softened, state = model.for_tip(position)
    return {'softened': list(softened), 'state': model.state(state)}


def _bending(given: list[list[float]]) -> Any:
    return np.array(given, dtype=float)


def _plain(value: Any) -> Any:
    """Return lists and dictionaries of floats, as JSON has them: what is not finite as text."""
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float | np.floating) and not np.isfinite(value):
        return str(float(value))
    return value.item() if isinstance(value, np.generic) else value


def main() -> None:
    """Write what is not there."""
    NUMBERS.mkdir(exist_ok=True)
    for name in names():
        path = NUMBERS / f'{name}.json'
        if not path.exists():
            text = json.dumps(answers(question(name)), separators=(',', ':'), allow_nan=False)
            path.write_text(text + '\n', encoding='utf-8')
            print(f'{path.name}: {len(text) / 1e3:.0f} kB')


if __name__ == '__main__':
    main()
