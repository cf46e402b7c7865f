# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The verbs that operate a running arm, from ``status`` to ``tare``."""

from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
import json
from math import isfinite
import os
import signal
import sys
from time import sleep
from typing import Any, NoReturn, TYPE_CHECKING

from soft_continuum.parameters.arguments import (
    AS_PREDICTED,
    command_name,
    COMMON_OPTIONS,
    DONE,
    FAILED,
    FOR_NODES,
    given_path,
    in_verbs,
    INTERRUPTED,
    NO_NODES,
    number_in,
    Parser,
    WRONG_USAGE,
)
from soft_continuum.sequencing import AIMS
from soft_continuum.text import MAX_NAME, printable, read_bytes
from soft_continuum.ui.cli.goals import (
    add_tip,
    add_tolerance,
    add_unit,
    given_tip,
    parse_bendings,
    read_tip_path,
    tip_problem,
    UNITS,
)
from soft_continuum.user_files import saved_shapes, shape_names

if TYPE_CHECKING:
    from soft_continuum.client import Arm, Progress
    from soft_continuum.client.sequence import RunningSequence, ShapeLike

WATCH_PERIOD = 0.5  # s
CANCEL_TIMEOUT = 60.0  # s for a canceled sequence to come to rest
MAX_JOG = 1000.0  # mm; pull_limits are tighter
MAX_CACHE = 100_000  # bytes
BAR_LENGTH = 24  # characters
INTERRUPTS = (signal.SIGINT, signal.SIGTERM)


@dataclass(frozen=True)
class Action:
    """
    A verb on a running arm.

    help: one line.  run: called with the arm; returns the exit status.  add_options: adds the
    verb's own options.  missing: returns what the options lack, empty if they are complete.
    """

    help: str
    run: Callable[['Arm', Namespace, 'Output'], int]
    add_options: Callable[[Parser], None] = lambda parser: None
    missing: Callable[[Namespace], str] = lambda options: ''


def main(verb: str, argv: Sequence[str] | None = None) -> int:
    """Run a verb on a running arm; return the exit status."""
    action = ACTIONS[verb]
    parser = Parser(verb, action.help, *FOR_NODES)
    action.add_options(parser)
    options = parser.parse_args(argv)
    if missing := action.missing(options):
        parser.error(missing)
    output = Output(parser, options.json)
    for number in INTERRUPTS:
        signal.signal(number, _interrupt)
    try:
        from soft_continuum.client import Arm, ClientError, NodesMissingError
    except ImportError as error:
        from soft_continuum.extras import remedy
        return output.fail(remedy(error) or error)
    try:
        with Arm(options.namespace, timeout=options.timeout) as arm:
            return action.run(arm, options, output)
    except ClientError as error:
        return output.fail(error, NO_NODES if isinstance(error, NodesMissingError) else FAILED)


def _interrupt(*_: object) -> NoReturn:
    """Interrupt the verb; a second time, end the process at once."""
    for number in INTERRUPTS:
        signal.signal(number, lambda *_: os._exit(INTERRUPTED))
    raise KeyboardInterrupt


class Output:
    """Prints text or, with ``--json``, one JSON document per line."""

    def __init__(self, parser: Parser, as_json: bool) -> None:
        """parser: reports failures to people."""
        self.as_json = as_json
        self._parser = parser
        self._bar = ''

    def print(self, text: str, **data: Any) -> None:
        """Print ``text``, or ``data`` as JSON."""
        self._end_bar()
        print(json.dumps(_plain(data)) if self.as_json else in_verbs(text), flush=True)

    def done(self, text: str = 'done') -> int:
        """Report success; return the exit status."""
        self.print(text, result='done', message=text)
        return DONE

    def fail(self, reason: object, status: int = FAILED) -> int:
        """Report failure; return the exit status."""
        if self.as_json:
            self.print('', result='failed', message=str(reason))
            return status
        self._end_bar()
        return self._parser.fail(reason, status)

    def progress(self, now: 'Progress', before: 'Progress | None') -> None:
        """Show the progress of a sequence: a bar on a terminal, else one line for each phase."""
        if self.as_json:
            self.print('', **asdict(now))
            return
        from soft_continuum.client.state import progress_text
        text = f'{100 * now.fraction:3.0f} %  {now.shape}, {progress_text(now)}'
        if sys.stdout.isatty():
            full = round(BAR_LENGTH * now.fraction)
            line = f'[{"#" * full}{"." * (BAR_LENGTH - full)}] {text}'
            print(f'\r{line:<{len(self._bar)}}', end='', flush=True)
            self._bar = line
        elif before is None or _step(now) != _step(before):
            print(text, flush=True)

    def _end_bar(self) -> None:
        if self._bar:
            print(flush=True)
            self._bar = ''


def _step(now: 'Progress') -> tuple[object, ...]:
    """Return the part of the progress that starts a new line when it changes."""
    return now.shape_index, now.segment, now.phase, now.correction


def _plain(value: Any) -> Any:
    """Return a value for JSON: nan becomes null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


# Shapes.


def _shape_name(text: str) -> str:
    """Read the name of a shape; point out bending angles, which need an option."""
    try:
        parse_bendings(text)
    except ArgumentTypeError:
        return text
    raise ArgumentTypeError(f'{text!r} given; bending angles in degrees need --angles {text}')


def _run_options(parser: Parser) -> None:
    shapes = parser.add_argument('shapes', nargs='*', metavar='SHAPE', type=_shape_name,
                                 help='names in the library, or of saved shapes and sequences')
    shapes.completer = cached_shapes  # type: ignore[attr-defined]
    parser.add_argument('--angles', action='append', type=parse_bendings, default=[],
                        metavar='A,B,C', help='bending angle of each segment, base first, '
                        'degrees, set after the named shapes; may be repeated. For spatial arms, '
                        'A@D bends towards the direction D, degrees about z from x')
    _add_hold(parser)
    _add_vacuums(parser)
    parser.add_argument('--aim', choices=AIMS, default=AIMS[0],
                        help='controlled quantity in closed loop: the angle of every segment, or '
                        'the position of the tip (default: %(default)s)')
    parser.add_argument('--repeat', type=_rounds, metavar='N', help='number of times to repeat '
                        'everything, 0: until Ctrl-C (default: 1; for a single saved sequence its '
                        'own number)')


def _add_vacuums(parser: Parser) -> None:
    """Add the option for the vacuums at which shapes are held."""
    parser.add_argument('--vacuums', type=_vacuums, metavar='A,B,C', help='for rigs with '
                        'regulators, vacuum of each segment while shapes are held, base first, '
                        'kPa (default: that of the shape in the library, else every segment '
                        'stiff)')


def _rounds(text: str) -> int:
    if not (text.isdecimal() and text.isascii() and len(text) < 8):
        raise ArgumentTypeError(f'{text!r} given; needed: a whole number; 0: until Ctrl-C')
    return int(text)


def _add_hold(parser: Parser) -> None:
    """Add the option for the hold time of shapes."""
    parser.add_argument('--hold', type=number_in(0.0, 86400.0, 's'), default=0.0, metavar='S',
                        help='hold time of each shape (default: 0 s)')


def _run(arm: 'Arm', options: Namespace, output: Output) -> int:
    """Set shapes as often as requested."""
    rounds = options.repeat
    if rounds is None:
        rounds = 1
        if len(options.shapes) == 1 and not options.angles and saved_shapes().exists():
            from soft_continuum.client.own_file import read_saved
            name, = options.shapes
            saved = read_saved().sequences
            if name in saved and name not in arm.shapes:
                rounds = saved[name].rounds
    shapes = _held([*options.shapes, *options.angles], options)
    status, done = DONE, 0
    while status in (DONE, AS_PREDICTED) and (done < rounds or not rounds):
        status, done = _watch_sequence(arm.start(
            *shapes, hold=options.hold, aim=options.aim),
            output), done + 1
    return status


def _held(shapes: Sequence[Any], options: Namespace) -> 'Sequence[ShapeLike]':
    """Return the shapes, to be held at the vacuums that were given, if any."""
    if options.vacuums is None:
        return shapes
    from soft_continuum.client import Held
    return [Held(shape, options.vacuums) for shape in shapes]


def _watch_sequence(sequence: 'RunningSequence', output: Output) -> int:
    """Show a sequence; the first Ctrl-C cancels it and waits for the arm to come to rest."""
    from soft_continuum.client import SequenceError
    from soft_continuum.client.state import reached_text
    before: Progress | None = None
    interrupted = False
    try:
        try:
            for now in sequence.updates():
                output.progress(now, before)
                before = now
        except KeyboardInterrupt:
            interrupted = True
            if not output.as_json:
                output.print('canceling; press Ctrl-C again to exit at once')
            sequence.cancel()
        result = sequence.result(CANCEL_TIMEOUT)
        reached = f'\n{reached_text(result.reached)}' if result.reached else ''
        lacks = f', but {result.message}' if result.message else ''
        output.print(f'done{lacks}{reached}', result='done', **asdict(result))
        if interrupted:
            return INTERRUPTED  # by a late Ctrl-C
        return AS_PREDICTED if result.reached and result.reached.lost else DONE
    except SequenceError as error:
        if output.as_json:
            output.print('', result='failed', **asdict(error.result))
        else:
            output.fail(str(error))
        return INTERRUPTED if interrupted else FAILED


def _reach_options(parser: Parser) -> None:
    add_tip(parser)
    _add_hold(parser)
    _add_vacuums(parser)


def _reach(arm: 'Arm', options: Namespace, output: Output) -> int:
    return _watch_sequence(arm.start(
        *_held([given_tip(options)], options), hold=options.hold), output)


def _follow_options(parser: Parser) -> None:
    parser.add_argument('file', type=given_path, metavar='FILE',
                        help='CSV file with the columns x and z or x, y and z, and optionally '
                        'angle')
    parser.add_argument('--decimal', **COMMON_OPTIONS['--decimal'])
    add_unit(parser, 'unit of lengths if the header has none, and of the tolerance')
    add_tolerance(parser)
    _add_hold(parser)


def _follow(arm: 'Arm', options: Namespace, output: Output) -> int:
    from soft_continuum.lab.analysis.delimited import MeasurementError
    try:
        tips = read_tip_path(options.file, options.unit, UNITS[options.unit] * options.tolerance,
                             options.decimal)
    except MeasurementError as error:
        return output.fail(error, WRONG_USAGE)
    return _watch_sequence(arm.start(tips, hold=options.hold), output)


def _shapes(arm: 'Arm', _: Namespace, output: Output) -> int:
    from soft_continuum.client.own_file import read_saved, sequence_text
    from soft_continuum.client.state import angles_text
    library = {printable(name, MAX_NAME): angles for name, angles in arm.shapes.items()}
    directions = {printable(name, MAX_NAME): values
                  for name, values in arm.shape_directions.items()}
    saved = read_saved()
    if saved.problem:
        print(saved.problem, file=sys.stderr)
    offered = saved.offered(arm.description, library)
    _cache_shapes([*library, *offered.shapes, *offered.sequences])
    output.print('\n'.join((
        *(f'{name:<20}{angles_text(values, directions.get(name, ()))}'
          for name, values in library.items()),
        *(f'{name:<20}{angles_text(shape.angles, shape.directions)}, saved'
          for name, shape in offered.shapes.items()),
        *(f'{name:<20}{sequence_text(sequence)}, saved'
          for name, sequence in offered.sequences.items()))),
        shapes=library, shape_directions=directions,
        saved_shapes={name: asdict(shape) for name, shape in offered.shapes.items()},
        saved_sequences={name: asdict(sequence) for name, sequence in offered.sequences.items()})
    return DONE


def cached_shapes(**_: Any) -> list[str]:
    """Return the names in the shape library when it was last listed: TAB waits for no nodes."""
    try:
        return read_bytes(shape_names(), MAX_CACHE).decode('utf-8').splitlines()
    except (OSError, ValueError):
        return []


def _cache_shapes(names: Iterable[str]) -> None:
    """Cache the names in the shape library for the next TAB."""
    with suppress(OSError):
        shape_names().parent.mkdir(parents=True, exist_ok=True)
        shape_names().write_text('\n'.join(names), encoding='utf-8')


# Segments.


def _segment(text: str) -> int:
    if not (text.isdecimal() and int(text) > 0):
        raise ArgumentTypeError(
            f'{text!r} given; needed: the number of a segment, 1 at the base')
    return int(text)


def _stiffen_options(parser: Parser) -> None:
    segment = parser.add_argument(
        'segment', type=lambda text: None if text == 'all' else _segment(text), metavar='N|all',
        help='1 at the base')
    segment.completer = lambda **_: ['all']  # type: ignore[attr-defined]


def _stiffen(arm: 'Arm', options: Namespace, output: Output) -> int:
    arm.stiffen(options.segment)
    return output.done(f'segment {options.segment} is stiff' if options.segment
                       else 'all segments are stiff')


def _soften_options(parser: Parser) -> None:
    parser.add_argument('segment', type=_segment, metavar='N', help='1 at the base')


def _soften(arm: 'Arm', options: Namespace, output: Output) -> int:
    arm.soften(options.segment)
    return output.done(f'segment {options.segment} is soft')


PASCALS = {'Pa': 1.0, 'kPa': 1e3}
MAX_VACUUM = 120e3  # Pa; the regulators take less


def _vacuum_options(parser: Parser) -> None:
    _soften_options(parser)
    parser.add_argument('vacuum', type=float, metavar='VACUUM', help='below ambient; 0: soft')
    parser.add_argument('--unit', choices=PASCALS, default='kPa',
                        help='of VACUUM (default: %(default)s)')


def _vacuum(arm: 'Arm', options: Namespace, output: Output) -> int:
    arm.set_vacuum(options.segment, options.vacuum * PASCALS[options.unit])
    return output.done(f'segment {options.segment} has {options.vacuum:g} {options.unit} of '
                       'vacuum')


def _vacuums(text: str) -> tuple[float, ...]:
    """Read ``80,30,80`` in kPa; return Pa."""
    return tuple(1e3 * number_in(0.0, MAX_VACUUM / 1e3, 'kPa')(part) for part in text.split(','))


# Tendons.


def _move(text: str) -> tuple[str, float]:
    """Read ``right=1.5``, in mm; return the tendon and m."""
    tendon, equals, distance = text.partition('=')
    if not (tendon and equals):
        raise ArgumentTypeError(f'{text!r} given; needed: TENDON=MM, such as right=1.5')
    return tendon, 1e-3 * number_in(-MAX_JOG, MAX_JOG, 'mm')(distance)


def _jog_options(parser: Parser) -> None:
    parser.add_argument('moves', nargs='*', type=_move, metavar='TENDON=MM',
                        help='distance in mm to pull in a tendon, such as right=1.5; negative: '
                        'pay out')


def _jog(arm: 'Arm', options: Namespace, output: Output) -> int:
    from soft_continuum.client.state import pulls_text
    arm.jog(**dict(options.moves))
    return output.done(f'pulls: {pulls_text(arm.state)}')


# Obstacles.


def _obstacles_options(parser: Parser) -> None:
    parser.add_argument('file', nargs='?', type=given_path, metavar='FILE',
                        help='YAML file with obstacles to add, such as '
                        'config/obstacles_example.yaml')
    parser.add_argument('--remove', action='append', default=[], metavar='NAME',
                        help='obstacle to remove; may be repeated')
    parser.add_argument('--clear', action='store_true',
                        help='remove all before those of FILE are added')
    parser.add_argument('--list', action='store_true',
                        help='only list the obstacles that shape_sequencer plans with (as without '
                        'options)')
    parser.add_argument('--unit', choices=('m', 'mm'), default='m',
                        help='unit of the printed list; FILE has its own (default: %(default)s)')


def _obstacles(arm: 'Arm', options: Namespace, output: Output) -> int:
    """Change the obstacles, then list them."""
    from soft_continuum.client.obstacles import obstacles_text
    obstacles = arm.obstacles
    if options.remove:
        obstacles.remove(*options.remove)
    if options.file is not None:
        obstacles.load(options.file, replace=options.clear)
    elif options.clear:
        obstacles.clear()
    known = obstacles.known
    output.print(obstacles_text(known, options.unit), obstacles=[
        {'name': one.name, 'shape': one.shape.kind, 'position': one.position,
         'orientation': one.orientation, 'size': one.size} for one in known])
    return DONE


# The whole arm.


def _status(arm: 'Arm', _: Namespace, output: Output) -> int:
    state = arm.state
    output.print(str(state), **asdict(state))
    return DONE


def _watch(arm: 'Arm', _: Namespace, output: Output) -> int:
    from soft_continuum.client.state import state_line
    try:
        while True:
            state = arm.state
            output.print(state_line(state), **asdict(state))
            sleep(WATCH_PERIOD)
    except KeyboardInterrupt:
        return DONE


def _tare(arm: 'Arm', _: Namespace, output: Output) -> int:
    answers = arm.tare()
    output.print('\n'.join(f'{node}: {answer}' for node, answer in answers.items()),
                 result='done', answers=answers)
    return DONE


def _sure_options(parser: Parser) -> None:
    parser.add_argument('--yes', action='store_true', help='do not ask for confirmation if the '
                        'arm was last known to be bent')


ACTIONS = {
    'status': Action('show the state of the arm and its nodes', _status),
    'watch': Action('show the state of the arm twice per second, until Ctrl-C', _watch),
    'shapes': Action('list the shape library', _shapes),
    'run': Action(
        'set shapes in sequence; Ctrl-C cancels', _run, _run_options,
        lambda options: '' if options.shapes or options.angles else
        f'give a SHAPE or --angles; `{command_name("shapes")}` lists the names'),
    'reach': Action('move the tip to a position; Ctrl-C cancels', _reach, _reach_options,
                    tip_problem),
    'follow': Action('move the tip along a path from a file', _follow, _follow_options),
    'stiffen': Action('evacuate a segment, or all, and wait until it is stiff', _stiffen,
                      _stiffen_options),
    'soften': Action('vent a segment and wait until it is soft', _soften, _soften_options),
    'vacuum': Action('set the vacuum of a segment with a regulator', _vacuum, _vacuum_options),
    'jog': Action(
        'pull in or pay out tendons by some mm while a segment is soft', _jog, _jog_options,
        lambda options: '' if options.moves else 'give TENDON=MM, such as right=1.5 left=-1.5'),
    'obstacles': Action(
        'list, add or remove obstacles', _obstacles, _obstacles_options, lambda options:
        '--list cannot be combined with FILE, --remove or --clear; leave out one or the other'
        if options.list and (options.file or options.remove or options.clear) else ''),
    'home': Action('straighten the arm from any shape, with a sequence or all at once',
                   lambda arm, _, output: output.done(arm.home())),
    'stop': Action('stop all motion, holding tension',
                   lambda arm, _, output: output.done(arm.stop())),
    'resume': Action('allow motion after a stop',
                     lambda arm, _, output: output.done(arm.resume())),
    'reference': Action('set the present pulls as the zero of the straight arm',
                        lambda arm, options, output: output.done(arm.reference(options.yes)),
                        _sure_options),
    'reset': Action('reset kinematics to the straight arm',
                    lambda arm, options, output: output.done(arm.reset(options.yes)),
                    _sure_options),
    'tare': Action('take the present measurements as those of the straight arm', _tare),
}
