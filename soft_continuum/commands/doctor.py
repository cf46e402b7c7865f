# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Check a rig step by step, without ROS, and without moving or switching anything."""

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from importlib import import_module
import json
import os
from pathlib import Path
import sys
from time import monotonic

from soft_continuum.hardware.checks import (
    Check,
    check_jamming,
    check_ports,
    check_tendons,
    FAIL,
    OK,
    WARN,
)
from soft_continuum.parameters.parameter import ParameterError

NAME = 'doctor'
INTERRUPTED = 130


def main(argv: list[str] | None = None) -> int:
    """Run the command: 0 nothing failed, 1 something did, 2 bad options."""
    parser = argparse.ArgumentParser(
        prog=NAME, allow_abbrev=False,
        description='Check parameter files, model, ports, firmware, settings, valves and sensors '
        'step by step. Nothing is moved or switched. Nodes that use the rig must not run.')
    parser.add_argument('--params-file', type=Path, action='append', default=[], metavar='FILE',
                        help='parameter file as the nodes take it; may be repeated, later ones '
                        "win (default: the paper's arm, simulated)")
    parser.add_argument('--json', action='store_true',
                        help='print one JSON document: the result, and of every check the step, '
                        'the status and the message')
    options = parser.parse_args(argv)
    found: list[Check] = []
    try:
        for check in checks(options.params_file):
            found.append(check)
            if not options.json:
                print(f'{check.status:<4}  {check.step}: {check.message}', flush=True)
    except BrokenPipeError:  # such as into head: what was printed so far was enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        print(f'\n{NAME}: interrupted', file=sys.stderr)
        return INTERRUPTED
    failed = sum(check.status == FAIL for check in found)
    if options.json:
        print(json.dumps({'result': FAIL if failed else OK,
                          'checks': [asdict(check) for check in found]}, indent=2))
    else:
        warned = sum(check.status == WARN for check in found)
        print(f'\n{len(found)} checks: {failed} failed, {warned} to be looked at')
    return 1 if failed else 0


def checks(paths: list[Path]) -> Iterator[Check]:
    """Yield what each step finds; steps that need one that failed are left out."""
    model = _check_model()
    yield model
    if model.status == FAIL:  # the parameter files describe a model
        return
    from soft_continuum.commands.rig import rig_parameters  # imports the model

    where = ', '.join(str(path) for path in paths) or "none given: the paper's arm, simulated"
    try:
        values = rig_parameters(paths)
    except ParameterError as error:
        yield Check('parameters', FAIL, str(error))
        return
    yield Check('parameters', OK, where)
    yield check_ports(values)
    yield from check_tendons(values)
    yield from check_jamming(values)


def _check_model() -> Check:
    step, begin = 'model', monotonic()
    try:
        # Here, not above: an installation that cannot compile is to be diagnosed too.
        statics = import_module('soft_continuum.mechanics.statics')
        compiling = import_module('soft_continuum.mechanics._compile')
        if not compiling.is_compiled():
            print('compiling the model, which takes about a minute once ...', file=sys.stderr)
        statics.warm_up()
    except Exception as error:  # numba and its compiler fail in many ways
        return Check(step, FAIL, f'does not compile: {type(error).__name__}: {_first(error)}; '
                     'check that ~/.cache can be written to, and the versions of numba and NumPy')
    if not compiling.COMPILED:
        return Check(step, WARN, 'works, but numba is not installed, so it runs many times '
                     'slower; install python3-numba (apt) or numba (pip)')
    return Check(step, OK, f'compiled, ready after {monotonic() - begin:.1f} s')


def _first(error: Exception) -> str:
    return (str(error).strip() or 'no reason given').splitlines()[0]


if __name__ == '__main__':
    sys.exit(main())
