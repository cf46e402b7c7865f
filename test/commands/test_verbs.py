# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""There is one command line: one list of verbs, one style of options, errors and completion."""

import argparse
from importlib import import_module
import os
from pathlib import Path
import re
import runpy
import subprocess
import sys
from types import SimpleNamespace

import pytest
import setuptools

from soft_continuum.client.sequence import sequence_result
from soft_continuum.client.state import progress_of
from soft_continuum.parameters import arguments
from soft_continuum.text import printable
from soft_continuum.ui.cli.main import main, VERBS

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / 'bin' / 'soft_continuum'
OWN_PARSER = [name for name, verb in VERBS.items() if verb.completes]


@pytest.fixture
def call(capsys, monkeypatch):
    """Return a function that runs the command line: exit status, stdout, stderr."""
    monkeypatch.setattr(sys, 'argv', [str(SCRIPT)])

    def run(*words):
        try:
            status = main(words)
        except SystemExit as ended:  # argparse
            status = ended.code
        return status, *capsys.readouterr()

    return run


# The registry.


@pytest.mark.parametrize('name', VERBS)
def test_a_verb_of_the_registry_has_a_function(name):
    module, _, function = VERBS[name].target.partition(':')
    assert callable(getattr(import_module(f'soft_continuum.{module}'), function))


def test_every_verb_is_listed_with_what_it_does(call):
    status, output, _ = call('--help')
    assert status == arguments.DONE
    for verb in VERBS.values():
        assert f'  {verb.name} ' in output and f' {verb.help}\n' in output


def test_every_executable_of_ros2_run_is_a_verb(monkeypatch):
    given = {}
    monkeypatch.setattr(setuptools, 'setup', given.update)
    monkeypatch.chdir(ROOT)
    runpy.run_path('setup.py')
    names = {script.split(' = ')[0] for script in given['entry_points']['console_scripts']}
    assert names <= VERBS.keys()
    assert names >= {'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer',
                     'grbl_emulator', 'modbus_emulator', 'browser', 'record'}


# Help and options.


@pytest.mark.parametrize('name', OWN_PARSER)
def test_the_help_of_a_verb_names_it_and_its_exit_codes(call, name):
    status, output, _ = call(name, '--help')
    assert status == arguments.DONE
    assert output.startswith(f'usage: soft_continuum {name.removesuffix("_emulator")}'
                             if 'emulator' not in name else 'usage: soft_continuum emulate ')
    assert ' '.join(output.split()).endswith(' '.join(arguments.EXIT_CODES.split()))


def test_common_options_read_the_same_for_every_verb(call, monkeypatch):
    seen = {}

    def keep(parser, *_):
        for action in parser._actions:
            for option in action.option_strings:
                seen.setdefault(option, {})[parser.prog] = (
                    action.metavar, action.nargs, action.help)
        raise SystemExit(0)

    monkeypatch.setattr(arguments.Parser, 'parse_args', keep)
    for name in OWN_PARSER:
        module, _, function = VERBS[name].target.partition(':')
        with pytest.raises(SystemExit):
            getattr(import_module(f'soft_continuum.{module}'), function)(*VERBS[name].arguments)
    for option in ('--namespace', '--timeout', '--json', '--params-file', '--output', '--force'):
        assert len(seen[option]) > 1, option
        assert len(set(seen[option].values())) == 1, (option, seen[option])


@pytest.mark.parametrize(('script', 'program', 'shown'), [
    (str(SCRIPT), None, 'soft_continuum stop'),
    ('/opt/lib/python3/soft_continuum/__main__.py', None, 'python -m soft_continuum stop'),
    ('/opt/lib/python3/soft_continuum/__main__.py', './run', './run stop'),
    ('/opt/install/soft_continuum/lib/soft_continuum/stop', None, 'ros2 run soft_continuum stop'),
])
def test_usage_names_the_command_that_was_typed(capsys, monkeypatch, script, program, shown):
    monkeypatch.setattr(sys, 'argv', [script])
    if program:
        monkeypatch.setenv(arguments.PROGRAM, program)
    with pytest.raises(SystemExit):
        main(['stop', '--help'])
    assert capsys.readouterr().out.startswith(f'usage: {shown} [')


def test_the_version_is_that_of_the_package(call):
    status, said, _ = call('--version')
    assert status == arguments.DONE
    assert re.fullmatch(r'soft_continuum 0\.2\.0\+[0-9a-f]{8}\n', said)


@pytest.mark.parametrize(('words', 'reason'), [
    ((), 'no verb given'),
    (('fly',), "unknown verb 'fly' ("),
    (('stauts',), "unknown verb 'stauts'; did you mean status?"),
    (('learn',), "unknown verb 'learn'; it is named save-estimate now"),
    (('--jsno', 'status'), 'unknown option --jsno; did you mean --json?'),
    (('run', 'c_form', '--hodl=2'), 'unknown option --hodl; did you mean --hold?'),
    (('calibrate', 'steps', '--mesured', '5', '5'), 'did you mean --measured?'),
    (('emulate', 'grbl', '--lnik', 'x'), 'did you mean --link?'),
    (('stop', 'now'), "unexpected argument 'now'"),
    (('run',), 'give a SHAPE or --angles'),
    (('run', '--angles', '10,x'), "'10,x' given; needed: a bending angle in degrees"),
    (('run', '--angles', '-nan,1,2'), 'expected one argument'),
    (('run', '36,36,36'), 'bending angles in degrees need --angles 36,36,36'),
    (('run', 'c_form', '--hold', '-1'), "'-1' given; allowed: 0 to 86400 s"),
    (('run', 'c_form', '--hold', 'nan'), "'nan' given; allowed: 0 to 86400 s"),
    (('soften', 'x'), "'x' given; needed: the number of a segment"),
    (('soften', 'all'), "'all' given; needed: the number of a segment"),
    (('stiffen', '0'), "'0' given; needed: the number of a segment"),
    (('jog',), 'give TENDON=MM, such as right=1.5 left=-1.5'),
    (('jog', 'right'), "'right' given; needed: TENDON=MM, such as right=1.5"),
    (('jog', 'right=inf'), "'inf' given; allowed: -1000 to 1000 mm"),
    (('stop', '--timeout', '0'), "'0' given; allowed: 0.01 to 3600 s"),
    (('--timeout', '0', 'stop'), "'0' given; allowed: 0.01 to 3600 s"),
    (('completion', 'dos'), "invalid choice: 'dos'"),
])
def test_wrong_usage_is_one_line_that_says_what_is_allowed(call, words, reason):
    status, output, errors = call(*words)
    assert (status, output) == (arguments.WRONG_USAGE, '')
    assert reason in errors
    assert errors.startswith('soft_continuum') and errors.count('\n') == 1


def test_common_options_may_stand_before_the_verb(call):
    status, output, _ = call('--json', 'doctor', '--params-file', 'none.yaml')
    assert status == arguments.FAILED
    assert output.startswith('{"result": "FAIL"')


def test_a_stop_imports_neither_mechanics_nor_numpy():
    ran = subprocess.run(
        [sys.executable, '-c', 'import sys; from soft_continuum.ui.cli import main, operate; '
         'import soft_continuum.client.arm; print(*sys.modules)'],
        capture_output=True, text=True, timeout=60, check=True)
    assert not {'numba', 'numpy', 'scipy', 'matplotlib', 'soft_continuum.mechanics',
                'soft_continuum.client.state'} & set(ran.stdout.split())


def test_options_are_read_before_anything_is_loaded_that_takes_long():
    # Also by TAB, which builds the parser; scipy itself is light, it loads its modules when used.
    ran = subprocess.run([sys.executable, '-c', """
import sys
from soft_continuum.ui.cli.main import main
from soft_continuum.ui.cli.main import VERBS
for verb in VERBS.values():
    if verb.completes:
        try:
            main([verb.name, '--help'])
        except SystemExit:
            pass
print(*sys.modules, file=sys.stderr)
"""], capture_output=True, text=True, timeout=60, check=True)
    assert ran.stdout.count('usage: ') > 40
    assert not {'cv2', 'matplotlib', 'mujoco', 'numba', 'pandas', 'scipy.optimize',
                'scipy.spatial', 'scipy.stats'} & set(ran.stderr.split())


def test_the_installed_script_and_the_module_are_the_same_program():
    for program in [SCRIPT], ['-m', 'soft_continuum']:
        ran = subprocess.run([sys.executable, *program, 'stop', '--tmeout', '1'],
                             capture_output=True, text=True, timeout=60)
        assert ran.returncode == arguments.WRONG_USAGE
        assert 'soft_continuum stop: unknown option --tmeout; did you mean' in ran.stderr


# Values.


@pytest.mark.parametrize('text', ['nan', 'inf', '', '1.01', '-0.01', 'one'])
def test_a_number_outside_its_bounds_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match=r'allowed: 0 to 1 m$'):
        arguments.number_in(0.0, 1.0, 'm')(text)
    with pytest.raises(argparse.ArgumentTypeError, match='whole number from 2 to 9$'):
        arguments.whole_number_in(2, 9)(text)


# Tab completion.


def complete(*lines, cache):
    """Return what bash offers for the last word of each line."""
    script = '\n'.join((
        f'soft_continuum() {{ "{sys.executable}" "{SCRIPT}" "$@"; }}',
        'source <(soft_continuum completion bash)',
        *(f"COMP_LINE='{line}' COMP_POINT={len(line)} COMP_TYPE=9 IFS=$' \\t\\n'\n"
          '_python_argcomplete soft_continuum\necho "${COMPREPLY[*]}"' for line in lines)))
    ran = subprocess.run(['bash', '-c', script], capture_output=True, text=True, timeout=60,
                         check=True, env={**os.environ, 'XDG_CACHE_HOME': str(cache)})
    return [line.split() for line in ran.stdout.splitlines()]


def test_tab_completes_verbs_options_values_and_shapes(tmp_path, monkeypatch):
    (tmp_path / 'soft_continuum').mkdir()
    (tmp_path / 'soft_continuum' / 'shapes').write_text('c_form\ns_form')
    expected = {
        'soft_continuum st': ['status', 'stiffen', 'stop'],
        'soft_continuum stiffen ': ['all'],
        'soft_continuum run s_': ['s_form'],
        'soft_continuum run c_form --h': ['--hold', '--help'],
        'soft_continuum --json run c_form --r': ['--repeat'],
        'soft_continuum emulate ': ['grbl', 'modbus'],
        'soft_continuum calibrate st': ['steps'],
        'soft_continuum up --n': ['--namespace'],
        'soft_continuum kinematics ': [],  # not completed, and above all not started
    }
    found = complete(*expected, cache=tmp_path)
    for (line, offered), words in zip(expected.items(), found, strict=True):
        assert set(offered) <= set(words), line
        assert all(word.startswith(line.rpartition(' ')[2]) for word in words), line


# What nodes say, in the words of the command line.


@pytest.mark.parametrize(('message', 'shown'), [
    ('call ~/resume before any motion', 'type `soft_continuum resume` before any motion'),
    ('and call /tendon_actuation/reference', 'and type `soft_continuum reference`'),
    ('kinematics/reset if kinematics is wrong',
     '`soft_continuum reset` if kinematics is wrong'),
    ('(jamming_valves/segment_2/set_stiff)', '(`soft_continuum soften 2`)'),
    ('stopped (~/stop was called)', 'stopped (stop was called)'),
    ('~/resumed and /home/reset', '~/resumed and /home/reset'),
])
def test_services_are_named_by_their_verbs(monkeypatch, message, shown):
    monkeypatch.setattr(sys, 'argv', [str(SCRIPT)])
    assert arguments.in_verbs(message) == shown


def test_what_others_wrote_is_shown_on_one_line_within_bounds():
    assert printable('a\x1b[2J\r\nb\u202e\udcff') == r'a\x1b[2J\r\nb\u202e\udcff'
    assert printable('\u00b5 \u00fc') == '\u00b5 \u00fc'
    assert printable('x' * 5_000_000, 10) == 'xxxxxxxxxx... (5000000 characters)'


def test_a_feedback_within_no_bounds_is_progress_within_them():
    report = SimpleNamespace(shape_index=0, shape='\x1b' * 1000, segment=1, phase='flying')
    progress = progress_of(report, float('nan'))
    assert (progress.fraction, progress.phase) == (0.0, 'preparing')
    assert progress.shape.isprintable() and len(progress.shape) < 300


def test_a_goal_that_ended_in_an_unknown_way_has_a_result():
    message = SimpleNamespace(error_code=-99, error_string='a\nb', shapes_completed=0)
    result = sequence_result(message)
    assert (result.outcome, result.message) == ('error_code -99', r'a\nb')
