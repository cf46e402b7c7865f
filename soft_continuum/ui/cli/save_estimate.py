# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``save-estimate``: writes the parameters that kinematics has estimated to a file."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf
import sys
from typing import TYPE_CHECKING

from soft_continuum.client import ClientError
from soft_continuum.client.estimate import LearnedParameter, parameter_text, ParameterText
from soft_continuum.lab.analysis.verbs import origin, reserve_outputs, run_verb, text_table
from soft_continuum.parameters.arguments import Parser
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import ParameterError, Value

if TYPE_CHECKING:
    from soft_continuum.client import Estimate
    from soft_continuum.mechanics.arm import Arm

NAME = 'save-estimate'
FILE = 'estimated.yaml'
HOW_TO_SEE = 'does the node camera or disc_sensors run? See `soft_continuum status`'
HOW_TO_LEARN = ('the stiffness of a segment can be estimated while it is soft and carried by its '
                'own spring, its K when its load changes while it is stiff: set other shapes')
OF_HOMING = 'it belongs to the zero of the tendons: home them, or straighten the arm and reference'
BENDING, RATIOS = 'arm.bending_stiffnesses', 'arm.stiffness_ratios'
CHECKS = {p.name: p.check for p in ARM_PARAMETERS}


@dataclass
class Learned:
    """
    The content of the file, and what is left out.

    values: parameters of the description by name.  rows: quantity, described and estimated value,
    standard deviation, for the screen and the file.  offsets, left_out, problems: in words.
    """

    values: dict[str, Value] = field(default_factory=dict)
    rows: list[tuple[str, str, str, str, str]] = field(default_factory=list)
    offsets: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser(NAME, 'Save the parameters estimated since kinematics was started: stiffness, '
                    f'K and payload, as far as they are determined. Writes {FILE}; pass it to the '
                    'nodes after the other parameter files. Moves nothing.',
                    '--namespace', '--timeout', '--output', '--force')
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    from soft_continuum.client.arm import Arm as RunningArm
    from soft_continuum.client.state import source_text
    path, = reserve_outputs(options.output, [FILE], options.force)
    with RunningArm(options.namespace, timeout=options.timeout) as arm:
        estimate = arm.state.estimate
        learned = estimated_parameters(_known(estimate), arm.description)
        title = origin(NAME, arm.is_simulated, 'Estimated from measurements')
    _say(learned)
    assert estimate is not None
    write_parameters(path, learned.values, [
        title, f'Shape at that time: {source_text(estimate)}.',
        'Standard deviations of the estimates:',
        *(f'  {label}: {now} +- {stddev} {unit}, described: {before}'.replace(' ,', ',')
          for label, before, now, stddev, unit in learned.rows),
        *(f'As described: {text}' for text in learned.left_out),
        *(f'NOT PLAUSIBLE: {text}' for text in learned.problems),
        *(f'Not written: {text}' for text in learned.offsets)])
    print(f'\nWritten: {path}. Pass it to the nodes as another parameter file, after the others.')


def _known(estimate: 'Estimate | None') -> tuple[LearnedParameter, ...]:
    """Return the parameters of an estimate; raises ClientError if it has none."""
    from soft_continuum.client.state import source_text
    if estimate is None:
        raise ClientError('kinematics publishes no shape, so there is no estimate to save; see '
                          '`soft_continuum status`')
    if not estimate.parameters:
        raise ClientError(f'nothing is estimated, the shape is {source_text(estimate)}; '
                          f'{HOW_TO_SEE}')
    return estimate.parameters


def _say(learned: Learned) -> None:
    """Print the estimates; raise ClientError if none of them can be written."""
    for text in learned.offsets:
        print(f'offset, not written: {text}')
    if not learned.values:
        raise ClientError('nothing that a description has is determined yet: '
                          f'{"; ".join(learned.left_out) or "there are only offsets"}; '
                          f'{HOW_TO_LEARN}')
    print(text_table(['quantity', 'described', 'learned', '+-', 'unit'], learned.rows))
    if learned.left_out:
        print('\nLeft as described:', *learned.left_out, sep='\n  ')
    for text in learned.problems:
        print(f'{NAME}: warning: {text}; look at the arm before you use it', file=sys.stderr)


def estimated_parameters(parameters: Sequence[LearnedParameter], arm: 'Arm') -> Learned:
    """Return the estimates that fit into the description of the arm."""
    from soft_continuum.lab.analysis.identification import stiffnesses_of, with_mean
    learned, stiffnesses = Learned(), stiffnesses_of(arm)
    ratios = tuple(0.0 if s.jam.ratio == inf else s.jam.ratio for s in arm.segments)
    lists: dict[str, Value] = {**stiffnesses, RATIOS: ratios}

    def put(names: Sequence[str], index: int, value: float) -> dict[str, Value]:
        """Return the lists with a number of the first; the others stay in proportion to it."""
        new = with_mean(lists, names, (index,), value)
        checked = {name: CHECKS[name](new[name]) for name in names}
        lists.update(checked)
        return checked

    for parameter in parameters:
        text, segment = parameter_text(parameter), parameter.segment
        if parameter.kind == 'offset':
            if parameter.determined:
                learned.offsets.append(f'{text.label.removeprefix("offset, ")} is pulled in by '
                                       f'{text.amount()} beyond what its motor says; {OF_HOMING}')
        elif not parameter.determined:
            learned.left_out.append(f'{text.label}: not determined')
        elif segment is not None and not 1 <= segment <= len(arm.segments):
            learned.left_out.append(f'{text.label}: this arm has no such segment')
        elif parameter.kind == 'stiffness_factor' and segment is not None:
            if arm.segments[segment - 1].soft_law is not None:
                learned.left_out.append(f'{text.label}: a measured table replaces it')
            else:
                _take(learned, parameter, text, stiffnesses[BENDING][segment - 1], 'N m^2',
                      partial(put, tuple(stiffnesses), segment - 1))
        elif parameter.kind == 'stiff_ratio' and segment is not None:
            if arm.segments[segment - 1].jam.law is not None:
                learned.left_out.append(f'{text.label}: a measured table replaces it')
            else:
                _take(learned, parameter, text, 1.0, '', partial(put, (RATIOS,), segment - 1),
                      ratios[segment - 1] or inf)
        elif parameter.kind == 'payload':
            _take(learned, parameter, text, 1.0, 'kg', _payload, arm.payload)
        else:
            learned.left_out.append(f'{text.label}: no parameter of a description')
    return learned


def _payload(value: float) -> dict[str, Value]:
    return {'arm.payload': CHECKS['arm.payload'](value)}


def _take(learned: Learned, parameter: LearnedParameter, text: ParameterText, scale: float,
          unit: str, put: Callable[[float], dict[str, Value]], described: float | None = None
          ) -> None:
    """Store a determined value; scale: of the described quantity, if it is a factor."""
    value = scale * parameter.value
    try:
        if not value > 0.0 and parameter.kind != 'payload':  # 0 has a meaning of its own there
            raise ParameterError(f'{value:g} is not positive')
        learned.values |= put(value)
    except ParameterError as error:
        learned.left_out.append(f'{text.label}: {error}')
        return
    before = scale if described is None else described
    label = text.label.replace('stiffness factor', 'E I')
    learned.rows.append((label, 'rigid' if before == inf else f'{before:.4g}', f'{value:.4g}',
                         f'{scale * parameter.stddev:.2g}', unit))
    if parameter.problem:
        learned.problems.append(f'{label} {value:.4g}: {parameter.problem}')
