# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``doctor``: checks a rig, or the sensors or the network of a running arm; moves nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib import import_module
import json
import os
from pathlib import Path
import sys
from time import monotonic

from soft_continuum.commissioning.checks import (
    check_jamming,
    check_ports,
    check_real_time,
    check_tendons,
)
from soft_continuum.extras import missing, remedy, requirements, USES
from soft_continuum.hardware.commissioning import Check, FAIL, OK, WARN
from soft_continuum.parameters.arguments import (
    DONE,
    FAILED,
    in_verbs,
    INTERRUPTED,
    number_in,
    Parser,
)
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.text import printable

LISTENING = 3.0  # s


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status, FAILED if a check failed."""
    parser = Parser('doctor', 'Check parameter files, model, ports, firmware, settings, valves '
                    'and sensors step by step. Nothing is moved or switched. Nodes that use the '
                    'rig must not run, except with --sensors and --network, which need them.',
                    '--params-file', '--json', '--namespace')
    parser.add_argument('--sensors', action='store_true',
                        help='check cameras, trackers, IMUs and load cells while the nodes run')
    parser.add_argument('--network', action='store_true',
                        help='list the nodes on each computer and check round trips, loss, '
                        'clocks, versions, descriptions')
    parser.add_argument('--duration', type=number_in(1.0, 60.0, 's'), default=None, metavar='S',
                        help='time for which --sensors receives (default: 3 s)')
    options = parser.parse_args(argv)
    running = options.sensors or options.network
    if options.sensors and options.network:
        parser.error('--sensors and --network cannot be combined; give one of them')
    if running and options.params_file:
        parser.error('--params-file is for a rig without running nodes, not for --sensors or '
                     '--network')
    if options.duration is not None and not options.sensors:
        parser.error('--duration needs --sensors')
    found: list[Check] = []
    try:
        for check in (_running_checks('sensors', options.namespace, options.duration or LISTENING)
                      if options.sensors else _running_checks('network', options.namespace)
                      if options.network else checks(options.params_file, options.namespace)):
            found.append(check)
            if not options.json:
                message = printable(in_verbs(check.message))
                print(f'{check.status:<4}  {check.step}: {message}', flush=True)
    except KeyboardInterrupt:
        print(file=sys.stderr)
        return parser.fail('interrupted', INTERRUPTED)
    failed = sum(check.status == FAIL for check in found)
    if options.json:
        print(json.dumps({'result': FAIL if failed else OK,
                          'checks': [asdict(check) for check in found]}))
    else:
        warned = sum(check.status == WARN for check in found)
        print(f'\n{len(found)} checks: {failed} failed, {warned} to be looked at')
    return FAILED if failed else DONE


def _running_checks(what: str, namespace: str, *given: float) -> Iterator[Check]:
    """Yield the checks of ``doctor_sensors`` or ``doctor_network`` of a running arm."""
    try:
        from soft_continuum.client.connection import Connection
        from soft_continuum.client.errors import ClientError
        module = import_module(f'soft_continuum.commissioning.doctor_{what}')
    except ImportError as error:
        yield Check(what, FAIL, remedy(error) or str(error))
        return
    try:
        connection = Connection(f'doctor_{os.getpid()}', namespace)
        try:
            yield from module.checks(connection, *given)
        finally:
            connection.close()
    except ClientError as error:
        yield Check(what, FAIL, str(error))


def checks(paths: Sequence[Path], namespace: str = '') -> Iterator[Check]:
    """Yield the result of each step; steps that depend on a failed one are skipped."""
    yield from _check_packages()
    model = _check_model()
    yield model
    if model.status == FAIL:  # the parameter files describe a model
        return
    from soft_continuum.ros.description import load_rig  # imports the model

    where = ', '.join(str(path) for path in paths) or "none given: the paper's arm, simulated"
    try:
        values = load_rig(paths, namespace)
    except ParameterError as error:
        yield Check('parameters', FAIL, str(error))
        return
    yield Check('parameters', OK, where)
    yield check_real_time(values)
    yield check_ports(values)
    yield from check_tendons(values)
    if values['arm.jamming']:
        yield from check_jamming(values)


def _check_packages() -> Iterator[Check]:
    if not any(requirements().values()):
        yield Check('packages', WARN, 'cannot be checked, since soft_continuum is not installed')
        return
    found = [Check(f'packages for {extra}', WARN, text)
             for extra in USES if (text := missing(extra))]
    yield from found or [Check('packages', OK, 'all optional packages are installed')]


def _check_model() -> Check:
    step, begin = 'model', monotonic()
    try:
        # Imported here so that an installation that cannot compile can be diagnosed too.
        kernel = import_module('soft_continuum.mechanics._kernel')
        if kernel.must_build():
            print('compiling the model, which takes up to a minute once ...', file=sys.stderr)
        runs_in = kernel.functions().runs_in
    except Exception as error:  # numba and its compiler fail in many ways
        return Check(step, FAIL, f'does not compile: {type(error).__name__}: {_first(error)}; '
                     'check that ~/.cache is writable, and the versions of numba and NumPy')
    if runs_in == 'python':
        return Check(step, WARN, 'works, but numba is not installed, so it runs many times '
                     'slower; install python3-numba (apt) or numba (pip)')
    if runs_in == 'numba':
        return Check(step, WARN, 'works, but every start takes seconds longer because it could '
                     f'not be built: {kernel.why_not_built()}')
    return Check(step, OK, f'compiled, ready after {monotonic() - begin:.1f} s')


def _first(error: Exception) -> str:
    return (str(error).strip() or 'no reason given').splitlines()[0]
