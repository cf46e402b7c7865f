# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``new-arm`` writes a description that has what was answered, and says what is assumed."""

from itertools import chain, repeat
from math import pi, radians
import re
import shlex

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.lab.new_arm import description as new_arm
from soft_continuum.lab.new_arm.description import complete, describe_arm, questions_of
from soft_continuum.lab.new_arm.questions import AnswerError, DRAWINGS, KINDS, QUESTIONS
from soft_continuum.parameters.files import parameters_text
from soft_continuum.ros.description import load_arm, load_description
from soft_continuum.ui.cli.up import nodes_of
from support.flat_arm import guides_of


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Return a function that runs the verb with what is typed: status, output, errors."""
    def call(*words, typed=(), drawn=False):
        answers = chain(typed, repeat(EOFError))

        def answer(prompt):
            print(prompt, end='')
            found = next(answers)
            if not isinstance(found, str):
                raise found
            return found

        monkeypatch.setattr('builtins.input', answer)
        if not drawn:
            monkeypatch.setattr(new_arm, 'preview_figure', lambda *_: None)
        try:
            status = new_arm.main([*map(str, words), '--output', str(tmp_path)])
        except SystemExit as ended:  # argparse
            status = ended.code
        return status, *capsys.readouterr()

    return call


# From answers to arms.

@st.composite
def answered(draw):
    """Draw answers about an arm, as they are typed."""
    kind, n = draw(st.sampled_from(KINDS)), draw(st.integers(1, 4))

    def each(low, high, count=n):
        return draw(st.lists(st.floats(low, high), min_size=count, max_size=count))

    found = {'kind': kind, 'segments': [n], 'segment_lengths': each(5, 500),
             'outer_diameters': each(2, 200), 'disc_heights': each(1, 100, n + 1),
             'guide_offsets': each(0.5, 100), 'bending_stiffnesses': each(1e-5, 1.0),
             'segment_masses': each(0, 900), 'disc_masses': each(0, 900, n + 1),
             'bending_angle_limits': each(1, 179), 'mounting_angle': each(-180, 180, 1),
             'payload': each(0, 500, 1), 'pull_limit': each(1, 900, 1),
             'tension_limit': each(1, 500, 1)}
    if kind != 'planar':
        ends = draw(st.lists(st.integers(1, n), min_size=1, max_size=n, unique=True))
        found |= {'tendon_ends': sorted({*ends, n}), 'tendons': [draw(st.integers(2, 4))],
                  'torsional_stiffnesses': each(1e-6, 1.0)}
        found['first_tendon_angles'] = each(-180, 180, len(found['tendon_ends']))
    if kind == 'tendons':
        found['spacers'] = [draw(st.integers(0, 20))]
    return {name: value if isinstance(value, str) else tuple(map(float, value))
            for name, value in found.items()}


@settings(max_examples=25, suppress_health_check=[
    HealthCheck.too_slow, HealthCheck.function_scoped_fixture])
@given(answered())
def test_the_arm_of_the_file_has_what_was_answered(tmp_path, typed):
    described = describe_arm(complete(typed))
    path = tmp_path / 'arm.yaml'
    path.write_text(parameters_text(described.values, [], described.notes), encoding='utf-8')
    arm, values = load_arm(path), load_description(path)

    def near(value):
        return pytest.approx(value, rel=1e-6, abs=1e-9)

    mm = {name: [1e-3 * one for one in value] for name, value in typed.items() if name != 'kind'}
    for parts, what, name in (
            (arm.segments, 'length', 'segment_lengths'), (arm.discs, 'height', 'disc_heights'),
            (arm.segments, 'outer_diameter', 'outer_diameters'),
            (arm.discs, 'mass', 'disc_masses'), (arm.segments, 'mass', 'segment_masses')):
        assert [getattr(part, what) for part in parts] == near(mm[name])
    assert [s.bending_angle_limit for s in arm.segments] == near(
        [radians(one) for one in typed['bending_angle_limits']])
    assert arm.payload == near(mm['payload'][0])
    assert values['pull_limits'] == near((-mm['pull_limit'][0], mm['pull_limit'][0]))
    assert values['tension_limit'] == near(typed['tension_limit'][0])
    assert values['arm.mounting_angle'] == near(radians(typed['mounting_angle'][0]))
    assert values['arm.jamming'] is (typed['kind'] != 'tendons')
    assert arm.planar is (typed['kind'] == 'planar')
    if arm.planar:
        assert [s.stiffness_y for s in arm.segments] == near(typed['bending_stiffnesses'])
        assert guides_of(arm) == [near((one, one)) for one in mm['guide_offsets']]
        return
    assert [s.stiffness_x for s in arm.segments] == near(typed['bending_stiffnesses'])
    assert [s.stiffness_y for s in arm.segments] == near(typed['bending_stiffnesses'])
    assert [s.torsional_stiffness for s in arm.segments] == near(typed['torsional_stiffnesses'])
    assert arm.spacers == typed.get('spacers', (0,))[0]
    count = int(typed['tendons'][0])
    assert [t.end for t in arm.tendons] == [
        end for end in typed['tendon_ends'] for _ in range(count)]
    for number, tendon in enumerate(arm.tendons):
        first, turn = divmod(number, count)
        wanted = radians(typed['first_tendon_angles'][first]) + 2.0 * pi * turn / count
        assert (tendon.angle - wanted + pi) % (2.0 * pi) == near(pi)
        assert tendon.offset[::2] == near(mm['guide_offsets'][:tendon.end])


def test_a_stiffness_that_nobody_gave_is_that_of_the_rod_or_the_leaf_spring():
    arm = describe_arm(complete({'kind': 'tendons', 'rod_diameters': (0.7,)})).arm
    rod = 60e9 * pi / 64 * 0.0007**4  # nitinol
    assert [s.stiffness_x for s in arm.segments] == pytest.approx([rod] * 3, rel=1e-3)
    assert [s.torsional_stiffness for s in arm.segments] == pytest.approx([rod / 1.33] * 3, 1e-3)
    arm = describe_arm(complete({'kind': 'planar', 'leaf_thicknesses': (0.5, 0.35, 0.25)})).arm
    assert [s.stiffness_y for s in arm.segments] == pytest.approx(
        [200e9 * 0.0127 * t**3 / 12 for t in (5e-4, 3.5e-4, 2.5e-4)])


@pytest.mark.parametrize(('typed', 'words'), [
    ({'kind': 'planar', 'spacers': (3.0,)}, 'spacers: is for tendons, not for planar'),
    ({'segments': (2.0,), 'segment_lengths': (1.0, 2.0, 3.0)}, 'allowed: 1 or 2 numbers'),
    ({'tendon_ends': (1.0, 4.0)}, '1, 4 given; allowed: numbers from 1 to 3, each once'),
    ({'tendon_ends': (3.0, 3.0)}, 'each once')])
def test_answers_that_do_not_fit_together_are_refused(typed, words):
    with pytest.raises(AnswerError, match=words):
        complete({'kind': 'tendons'} | typed)


# The verb.


@pytest.mark.parametrize(('kind', 'nodes'), [('planar', 4), ('spatial', 3), ('tendons', 2)])
def test_without_questions_all_is_assumed_and_marked(run, tmp_path, kind, nodes):
    status, output, _ = run('arm', '--yes', '--kind', kind, '--segments', 2, drawn=True)
    assert status == 0
    path = tmp_path / 'arm.yaml'
    assumed = [q for q in questions_of(kind) if q.name not in ('kind', 'segments')]
    assert f'assumed in it: {", ".join(q.name for q in assumed)}\n' in output
    before = re.split(r'^ +(\w+):', path.read_text(encoding='utf-8'), flags=re.MULTILINE)
    marked = {key for text, key in zip(before[::2], before[1::2], strict=False)
              if 'ASSUMED:' in text}
    assert marked >= {q.parameter.removeprefix('arm.') for q in assumed if q.parameter} - (
        set() if kind == 'planar' else {'youngs_modulus'}) - {''} and 'pull_limits' in marked
    assert (tmp_path / 'arm.png').read_bytes().startswith(b'\x89PNG')
    assert 'The shape bow (30, 30 degrees)' in output or kind == 'tendons'
    assert len(nodes_of([path])) >= nodes


def test_the_command_in_the_file_makes_the_file_again(run, tmp_path):
    run('arm', '--yes', '--kind', 'tendons', '--segment-lengths', '60,62.5,64', '--tendon-ends',
        '1,2,3', '--first-tendon-angles', '-10,20,50')
    path = tmp_path / 'arm.yaml'
    first = path.read_text(encoding='utf-8')
    line = next(line for line in first.splitlines() if line.startswith('# soft_continuum'))
    assert run(*shlex.split(line)[3:], '--force')[0] == 0
    assert path.read_text(encoding='utf-8') == first


def test_questions_are_asked_again_until_they_are_answered(run, tmp_path):
    typed = ['tendns', 'tendons', '2', '60,70,80', '0', '60,70', *[''] * 11, '5', '1,2',
             *[''] * 9, 'segments', '1', '60', '1', 'yes']
    status, output, _ = run('arm', typed=typed)
    assert status == 0
    for words in ("'tendns' given; allowed: planar, spatial, tendons",
                  '3 numbers given; allowed: 1 or 2 numbers', "'0' given; allowed: numbers from 1",
                  '5 given; allowed: numbers from 1 to 2', 'segment_lengths: 2 numbers given',
                  '1, 2 given; allowed: numbers from 1 to 1, each once'):
        assert words in output
    arm = load_arm(tmp_path / 'arm.yaml')
    assert [s.length for s in arm.segments] == [0.06]
    assert [t.end for t in arm.tendons] == [1, 1, 1]


@pytest.mark.parametrize(('typed', 'status', 'words'), [
    (['tendons', '2', KeyboardInterrupt], 130, 'interrupted'),
    (['tendons'], 1, 'give the answers as options'),
    (['tendons', *[''] * 23, 'no'], 1, 'nothing was written')])
def test_what_is_not_finished_leaves_nothing(run, tmp_path, typed, status, words):
    ended, _, error = run('arm', typed=typed)
    assert ended == status
    assert words in error and error.count('\n') <= 2
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_there_stays_unless_it_is_given_up(run, tmp_path):
    there = tmp_path / 'arm.yaml'
    there.write_text('precious', encoding='utf-8')
    assert run('arm', '--yes', '--kind', 'planar')[0] == 2
    status, output, error = run('arm', typed=['no'])
    assert (status, output) == (2, f'{there} exists: overwrite? (yes, no) ')
    assert 'is unchanged' in error
    assert there.read_text(encoding='utf-8') == 'precious'
    assert run('arm', typed=['yes', 'planar', *[''] * 19, 'yes'])[0] == 0
    assert load_arm(there).planar


@pytest.mark.parametrize(('words', 'reason'), [
    (['--segment-lengths', '70mm'], "'70mm' given; allowed: numbers from 1 to 10000 mm"),
    (['--segments', '2.5'], "'2.5' given; allowed: whole numbers from 1 to 20"),
    (['--kind', 'rigid'], 'allowed: planar, spatial, tendons'),
    (['../arm'], 'allowed: letters, digits')])
def test_wrong_options_are_one_line_that_says_what_is_allowed(run, words, reason):
    status, output, error = run(*words, '--yes')
    assert (status, output) == (2, '')
    assert reason in error and error.count('\n') == 1


def test_a_shape_that_needs_more_than_is_allowed_is_told(run):
    _, output, _ = run('--yes', '--kind', 'tendons', '--rod-diameters', '2')
    assert 'This tension exceeds tension_limit, 10.0' in output


def test_every_drawing_belongs_to_a_question():
    assert DRAWINGS.keys() <= {question.name for question in QUESTIONS}
    assert all(len(line) < 60 for text in DRAWINGS.values() for line in text.splitlines())
