# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The commands print tables, write figures and parameters, and answer bad input with one line."""

from contextlib import chdir, redirect_stderr, redirect_stdout
import csv
from io import StringIO
from pathlib import Path
import re

import generate as specimen
from matplotlib.image import imread
import numpy as np
import pytest

from soft_continuum.lab.analysis import characterisation as characterize
from soft_continuum.lab.analysis import convergence as converge
from soft_continuum.lab.analysis import identification as identify
from soft_continuum.lab.analysis import validation as validate
from soft_continuum.lab.analysis import workspace
from soft_continuum.mechanics.laws import MomentCurvature
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_arm, load_description
from soft_continuum.user_files import description_file
from support import curve_files as files
from support.flat_arm import of_segments

DATA = Path(__file__).resolve().parents[2] / 'data' / 'simulated_specimen'
DOCUMENT = DATA.parents[1] / 'docs' / 'how_to' / 'measure_your_arm.md'
MASSES = str(DATA / 'SIMULATED_masses.yaml')
CURVES = str(DATA / 'SIMULATED_segment_2_soft.csv')
PAPER = [str(DATA / f'SIMULATED_paper_{kind}.csv') for kind in ('points', 'pulls')]
SHAPES = [str(DATA / f'SIMULATED_identification_{kind}.csv') for kind in ('points', 'pulls')]
CHARACTERIZE = ['--segment', '2', '--lever-arm', '0.025']
COMMANDS = {
    'characterize': (characterize, [CURVES, *CHARACTERIZE]),
    'validate': (validate, [*PAPER, '--params-file', MASSES]),
    'converge': (converge, ['--most', '6']),
    'identify': (identify, [
        *SHAPES, '--params-file', MASSES, '--fit', 'stiffness_1', 'stiffness_2', '--hold-out',
        'c_form', 's_form', 'upright_c_form', 'released_3', 'loaded', 'loaded_left']),
    'workspace': (workspace, ['--per-segment', '3']),
}


def run(command, *arguments):
    """Run a command: exit status, what it printed, and its errors."""
    with redirect_stdout(StringIO()) as printed, redirect_stderr(StringIO()) as errors:
        try:
            status = command.main([str(argument) for argument in arguments])
        except SystemExit as ended:  # argparse
            status = ended.code
    return status, printed.getvalue(), errors.getvalue()


@pytest.fixture(scope='module')
def documented(tmp_path_factory):
    """Run the lines of the document; return where their results are, and what each printed."""
    text = DOCUMENT.read_text(encoding='utf-8')
    lines = ''.join(re.findall(r'```sh\n(.*?)```', text, re.DOTALL)).splitlines()
    here, printed = tmp_path_factory.mktemp('documented'), {}
    (here / 'data').symlink_to(DATA.parent)
    with chdir(here):
        for line in lines:
            program, name, *arguments = line.split()
            assert program == './run'
            printed[name] = run(COMMANDS[name][0], *arguments)
    return here / 'results', printed


@pytest.fixture
def undrawn(monkeypatch):
    """Let commands draw nothing: that takes longer than all else they do."""
    for command, figure in ((characterize, 'stiffness_figure'), (converge, 'convergence_figure'),
                            (workspace, 'workspace_figure')):
        monkeypatch.setattr(command, figure, lambda *_: None)


# All commands

@pytest.mark.parametrize('name', COMMANDS)
def test_a_figure_is_grey_and_nothing_in_it_is_cut_off(documented, name):
    colours = imread(documented[0] / f'{name}.png')[:, :, :3]
    assert np.ptp(colours, axis=2).max() < 0.01
    ink = colours.min(axis=2) < 0.9
    assert 0.005 < ink.mean() < 0.5
    assert not any(edge.any() for edge in (ink[0], ink[-1], ink[:, 0], ink[:, -1]))


@pytest.mark.parametrize('name', COMMANDS)
def test_a_result_is_only_overwritten_by_force_and_a_bad_place_or_description_is_named(name):
    command, arguments = COMMANDS[name]
    there = Path('there', f'{name}.png')
    there.parent.mkdir()
    there.write_text('precious', encoding='utf-8')
    status, _, error = run(command, *arguments, '--output', 'there')
    assert (status, f'{there} exists; add --force' in error) == (2, True)
    assert there.read_text(encoding='utf-8') == 'precious'
    assert [*there.parent.iterdir()] == [there]
    status, _, error = run(command, *arguments, '--output', there)
    assert status == 2
    assert re.search(r'png: cannot be made: .*--output', error)
    status, _, error = run(command, *arguments, '--params-file', 'none.yaml')
    assert status == 2
    assert 'none.yaml: cannot be read' in error
    assert error.count('\n') == 1


@pytest.mark.parametrize('name', ['characterize', 'validate', 'converge', 'identify'])
def test_a_command_gives_the_same_again_to_the_byte(documented, name):
    command, arguments = COMMANDS[name]
    first, printed = documented
    if name == 'characterize':  # the document has the same arguments
        text = printed[name][1]
    else:
        first = Path('results')
        text = run(command, *arguments, '--output', first)[1]
    again = Path('again')
    again.mkdir()
    (again / f'{name}.png').write_text('old', encoding='utf-8')
    status, text_again, _ = run(command, *arguments, '--output', again, '--force')
    assert status == 0
    assert text_again == text.replace('results', 'again')
    for path in again.iterdir():
        assert path.read_bytes() == (first / path.name).read_bytes()


# characterize

@pytest.mark.usefixtures('undrawn')
def test_the_papers_slope_is_reproduced_from_a_file(tmp_path):
    path = files.export(tmp_path / 'a.csv', [(files.ramp(), 72.0 * files.ramp())],
                        'Weg [mm];Kraft [N]', ';', ',')
    status, text, _ = run(characterize, path, *CHARACTERIZE)
    assert status == 0
    for label, value in (('k, N/mm', '0.072'), (r'E I, N m\^2 \(eq. 8\)', '0.0202'),
                         (r'c_phi_i, n = 12, N m/rad \(eq. 5\)', r'3.75\d'),
                         ('error of the leaf spring alone', '55.1 %')):
        assert re.search(rf'{label} +{value}\n', text), label


@pytest.mark.usefixtures('undrawn')
def test_soft_and_stiff_give_the_ratio_and_keep_what_is_known_of_other_segments(tmp_path):
    up = files.ramp()
    soft = files.export(tmp_path / 'soft.csv', [(up, 72.0 * up)])
    stiff = files.export(tmp_path / 'stiff.csv', [(up / 10, 720.0 * up / 10)])
    run(characterize, soft, '--stiff', stiff, *CHARACTERIZE, '--output', 'two')
    first = 'two/characterize.yaml'
    status, _, _ = run(characterize, soft, '--segment', '1', '--lever-arm', '0.03',
                       '--params-file', first, '--output', 'one')
    assert status == 0
    arm = arm_from_parameters(load_description(first, 'one/characterize.yaml', node='kinematics'))
    assert arm.segments[1].jam.ratio == pytest.approx(10.0)
    assert arm.segments[1].stiffness_y == pytest.approx(0.0202, abs=5e-6)
    assert arm.segments[0].stiffness_y == pytest.approx(0.02335, abs=5e-6)
    assert arm.segments[0].jam.rigid


@pytest.mark.usefixtures('undrawn')
def test_a_segment_in_space_is_characterized_along_x_and_to_the_side(tmp_path):
    up, arm = files.ramp(), str(description_file().with_name('spatial_jamming.yaml'))
    along, side, stiff = (files.export(tmp_path / f'{name}.csv', [(part * up, slope * part * up)])
                          for name, slope, part in (
                              ('along', 72.0, 1.0), ('side', 90.0, 1.0), ('stiff', 720.0, 0.1)))
    given = ('--segment', '2', '--lever-arm', '0.025', '--params-file', arm)
    status, text, error = run(characterize, along, '--lateral', side, '--stiff', stiff, *given)
    assert status == 0, error
    before, after = load_arm(arm), load_arm(arm, 'characterize.yaml')
    one, other = after.segments[1], before.segments[1]
    assert (one.stiffness_y, one.stiffness_x) == pytest.approx(
        (0.0202, 0.0202 * 90.0 / 72.0), rel=2e-3)
    assert one.jam.ratio == pytest.approx(10.0)
    assert (after.segments[0], after.segments[2]) == (before.segments[0], before.segments[2])
    assert one.torsional_stiffness == other.torsional_stiffness
    assert 'leaf spring' not in text
    # A curve that is no line is written for the softer axis alone.
    for curvatures, softer in (((0.0, 10.0, 40.0), True), ((0.0, 1.0, 4.0), False)):
        law = MomentCurvature(curvatures, (0.0, 0.1, 0.2))  # E I 0.01 to 0.003, or 0.1 to 0.03
        force = np.linspace(0.0, 0.2 / 0.095, 60)
        bent = files.export(tmp_path / 'bent.csv', [(files.cantilever(law, force), force)])
        status, text, error = run(characterize, along, '--lateral', bent, *given, '--force',
                                  '--trust-stiffness')
        assert status == 0, error
        assert ('is written as a table' if softer else 'a description has a single table') in text
        assert (load_arm(arm, 'characterize.yaml').segments[1].soft_law is not None) == softer
    status, _, error = run(characterize, along, '--lateral', side, *CHARACTERIZE)
    assert (status, 'does not bend to the side' in error) == (2, True)


@pytest.mark.usefixtures('undrawn')
def test_stiffness_in_wrong_units_is_questioned_and_can_be_insisted_on(tmp_path):
    up = files.ramp()
    path = files.export(tmp_path / 'a.csv', [(up, 72.0 * up)], 'displacement [mm],force [kN]')
    status, _, error = run(characterize, path, *CHARACTERIZE)
    assert status == 2
    assert re.search(r'a\.csv: E I = 20.* off by about 1000.*--force-unit', error)
    assert not Path('characterize.yaml').exists()
    assert run(characterize, path, *CHARACTERIZE, '--force-unit', 'N')[0] == 0
    assert run(characterize, path, *CHARACTERIZE, '--trust-stiffness', '--output', 'x')[0] == 0


@pytest.mark.usefixtures('undrawn')
def test_a_segment_that_is_not_linear_becomes_a_table_that_the_arm_is_computed_with(tmp_path):
    law = MomentCurvature((0.0, 1.0, 6.0), (0.0, 0.03, 0.09))
    force = np.linspace(0.0, 0.9, 201)
    path = files.export(tmp_path / 'a.csv', [(files.cantilever(law, force), force)] * 2)
    stiffer = MomentCurvature((0.0, 1.0, 6.0), (0.0, 0.3, 0.9))
    stiff = files.export(tmp_path / 'b.csv', [(files.cantilever(stiffer, 10 * force),
                                               10 * force)] * 2)
    status, text, error = run(characterize, path, *CHARACTERIZE, '--stiff', stiff)
    assert status == 0, error
    assert 'The soft segment is not linear' in text
    assert 'The stiff segment is not linear' in text
    segments = load_arm('characterize.yaml').segments
    for measured, found in ((law, segments[1].soft_law), (stiffer, segments[1].jam.law)):
        for curvature in (0.5, 3.0, 5.0):
            assert found.moment(curvature) == pytest.approx(
                measured.moment(curvature), abs=0.05 * measured.moments[-1])
    assert [s.soft_law for s in segments[::2]] == [s.jam.law for s in segments[::2]] == [None] * 2


@pytest.mark.usefixtures('undrawn')
def test_a_curve_that_begins_before_the_machine_touches_is_not_passed_over(tmp_path):
    u = files.ramp()
    path = files.export(tmp_path / 'a.csv', [(u, files.SLOPE * np.maximum(u - 0.004, 0.0))] * 2)
    status, text, error = run(characterize, path, *CHARACTERIZE)
    assert status == 0, error
    assert 'is a mean only: its curves are no line' in text


@pytest.mark.usefixtures('undrawn')
@pytest.mark.parametrize('ratio', [1.2, 2.0])
def test_repetitions_of_two_states_in_one_file_are_questioned(tmp_path, ratio):
    u = files.ramp()
    path = files.export(tmp_path / 'a.csv', [(u, files.SLOPE * u), (u, ratio * files.SLOPE * u)])
    status, text, error = run(characterize, path, *CHARACTERIZE)
    assert status == 0, error
    assert ('segment differ: k is 0.072 to 0.144 N/mm. Are they of one' in text) == (ratio == 2.0)


@pytest.mark.usefixtures('undrawn')
def test_a_linear_segment_takes_its_table_out_of_the_description(tmp_path):
    table = tmp_path / 'table.yaml'
    table.write_text('/**:\n  ros__parameters:\n    arm:\n'
                     '      soft_curvatures: [0.0, 1.0, 0.0, 1.0, 4.0, 0.0]\n'
                     '      soft_moments: [0.0, 0.1, 0.0, 0.03, 0.09, 0.0]\n', encoding='utf-8')
    assert run(characterize, CURVES, *CHARACTERIZE, '--params-file', table)[0] == 0
    segments = load_arm(table, 'characterize.yaml').segments
    assert segments[0].soft_law == MomentCurvature((0.0, 1.0), (0.0, 0.1))
    assert segments[1].soft_law is None
    assert segments[1].stiffness_y == pytest.approx(0.0202, rel=0.01)


@pytest.mark.parametrize(('arguments', 'message'), [
    (CHARACTERIZE, 'no file given'),
    ([CURVES, '--segment', '2'], '--lever-arm'),
    ([CURVES, '--segment', '4', '--lever-arm', '0.025'],
     'there is no segment 4; --segment is 1 to 3'),
    ([CURVES, '--segment', '2', '--lever-arm', '25'], "'25' given; allowed: 0.0001 to 1 m"),
    (['none.csv', *CHARACTERIZE], 'none.csv: cannot be read'),
    ([CURVES, *CHARACTERIZE, '--stiff', CURVES], 'have the files of the two states been swapped'),
    ([CURVES, CURVES, *CHARACTERIZE], 'is given twice'),
    (['digits.csv', *CHARACTERIZE], 'digits.csv'),
])
def test_bad_options_of_characterize_are_answered(arguments, message):
    Path('digits.csv').write_text('Force [N];Displacement [mm]\n' + '1;1\n' * 20
                                  + '1' * 120_000 + 'x;1\n', encoding='utf-8')
    status, _, error = run(characterize, *arguments)
    assert status == 2
    assert message in error and len(error) < 5000
    assert [path.name for path in Path().iterdir()] == ['digits.csv']


# validate and identify

def errors_in(results):
    """Return the relative errors of the points in validate.csv, %, by shape and model."""
    errors = {}
    with open(results / 'validate.csv', encoding='utf-8', newline='') as file:
        for row in csv.DictReader(file):
            errors.setdefault((row['shape'], row['model']), []).append(
                float(row['error over distance from base [%]']))
    return errors


def test_validate_shows_the_papers_pattern_on_the_shipped_specimen(documented):
    results, printed = documented
    text, errors = printed['validate'][1], errors_in(results)
    assert len(errors) == 12
    assert all(len(points) == 6 for points in errors.values())
    worst = {key: max(points) for key, points in errors.items()}
    assert worst.pop(('c_form', 'chain, gravity')) == pytest.approx(22.0, abs=0.5)
    assert worst.pop(('c_form', 'chain, gravity, corrected')) < 3.0
    assert max(worst.values()) < 2.0
    # The table says the same.
    row, = re.findall(r'chain, gravity  +[\d.]+ +[\d.]+ +([\d.]+) .* step 2, step 3', text)
    assert float(row) == pytest.approx(22.0, abs=0.5)


def test_characterize_and_identify_recover_the_shipped_specimen_within_2_percent(documented):
    results, printed = documented
    segments = load_arm(results / 'characterize.yaml').segments
    assert segments[1].stiffness_y == pytest.approx(0.0202, rel=0.02)
    assert segments[0].stiffness_y == pytest.approx(
        0.026458, rel=1e-4)  # as described: its leaf spring
    arm = arm_from_parameters(load_description(
        MASSES, results / 'identify.yaml', node='kinematics'))
    for segment, true in zip(arm.segments, specimen.specimen().segments, strict=True):
        assert segment.stiffness_y == pytest.approx(true.stiffness_y, rel=0.02)
    unseen = [float(line.split()[-1]) for line in printed['identify'][1].splitlines()
              if line.startswith(('c_form', 'released', 'loaded'))]
    assert len(unseen) == 7
    assert max(unseen) < 2.0


ALL_SHAPES = ['released_1', 'released_1_left', 'released_2', 'released_3', 'loaded', 'loaded_left',
              'c_form']


@pytest.mark.parametrize(('command', 'arguments', 'message'), [
    (identify, [*PAPER, '--fit', 'friction', '--hold-out', 's_form'], 'do not determine friction'),
    (identify, [*SHAPES, '--fit', 'stiffness_9'],
     "no unknown 'stiffness_9'; known: stiffness_1"),
    (identify, [*SHAPES, '--hold-out', 'o_form'], "no shape 'o_form' to hold out"),
    (identify, [*SHAPES, '--hold-out', *ALL_SHAPES], 'do not determine'),
    (validate, PAPER[::-1], 'SIMULATED_paper_pulls.csv, line 2: no column for point'),
    (validate, [*PAPER, '--corrected', 'other.yaml'], 'other.yaml'),
    (workspace, ['--per-segment', '101'], '--per-segment 36 is the most'),
])
def test_what_the_commands_cannot_do_is_said(command, arguments, message):
    Path('other.yaml').write_text('/**: {ros__parameters: {arm: {segment_lengths: [0.07]}}}\n',
                                  encoding='utf-8')
    given = ['--params-file', MASSES] if command is identify else []
    status, _, error = run(command, *arguments, *given)
    assert (status, message in error) == (2, True), error
    assert [path.name for path in Path().iterdir()] == ['other.yaml']


# converge, workspace and the data

@pytest.mark.usefixtures('undrawn')
def test_converge_prints_the_papers_twelve(documented):
    assert 'Converged at n = 12' in documented[1]['converge'][1]
    assert 'Not converged' in run(converge, '--most', '8', '--output', 'x')[1]


@pytest.mark.usefixtures('undrawn')
def test_workspace_says_how_long_it_takes_and_is_coarser_for_more_segments(tmp_path):
    one = tmp_path / 'one.yaml'
    one.write_text('/**: {ros__parameters: {arm: {segment_lengths: [0.07], outer_diameters: '
                   '[0.05], leaf_thicknesses: [0.0005], leaf_widths: [0.0127], segment_masses: '
                   '[0.069], disc_heights: [0.03], disc_masses: [0.06], bending_angle_limits: '
                   '[1.0]}}}\n', encoding='utf-8')
    status, _, progress = run(workspace, '--params-file', one)
    assert status == 0
    assert re.search(r'3 times 11 shapes, about \d+ s', progress)
    assert '3 of 3, gravity, tip first' in progress
    arm = load_arm(one)
    assert [workspace.default_angles(of_segments(arm, [0] * n))
            for n in (1, 3, 4, 5, 12)] == [11, 11, 6, 4, 2]


def test_the_shipped_data_are_what_the_script_writes_and_say_that_they_are_simulated(tmp_path):
    written = specimen.write(tmp_path)
    assert sorted(p.name for p in written) == sorted(
        p.name for p in DATA.iterdir() if p.suffix in ('.csv', '.yaml'))
    for path in written:
        new = path.read_text(encoding='utf-8').splitlines()
        old = (DATA / path.name).read_text(encoding='utf-8').splitlines()
        assert path.name.startswith('SIMULATED_') and 'SIMULATED' in old[0]
        assert len(new) == len(old)
        for one, other in zip(new, old, strict=True):  # the last digit may be rounded otherwise
            numbers = [[float(n.replace(',', '.')) for n in re.findall(
                r'-?\d+[.,]\d{3,}', line)] for line in (one, other)]
            assert numbers[0] == pytest.approx(numbers[1], abs=0.0011)
            assert re.sub(r'[-\d.,]+', '', one) == re.sub(r'[-\d.,]+', '', other)


# Documents

def test_every_command_line_in_the_document_runs_and_gives_its_numbers(documented):
    results, printed = documented
    assert len(printed) == 5
    for status, _, error in printed.values():
        assert status == 0, error
    text = DOCUMENT.read_text(encoding='utf-8')
    for segment in load_arm(results / 'identify.yaml').segments:
        assert f'{segment.stiffness_y:.5f} |' in text
    worst = {(model, shape): max(points) for (shape, model), points in errors_in(results).items()}
    for model in dict(worst):
        cells = ' | '.join(f'{e:.1f}' for (of, _), e in worst.items() if of == model[0])
        assert f'| {cells} |' in text.replace('**', '')
    shown = re.search(r'```text\n(k, N/mm.*?)```', text, re.DOTALL)[1].splitlines()
    assert {*shown} <= {*printed['characterize'][1].splitlines()}


# Nothing is lost

def test_an_interrupted_identification_keeps_its_parameters(monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(identify, 'without', lambda shapes, names: (
        interrupt() if names else list(shapes)))
    status, text, error = run(identify, *SHAPES, '--params-file', MASSES)
    assert status == 130
    assert 'interrupted' in error
    assert 'stiffness_2' in text
    assert load_arm('identify.yaml').segments[1].stiffness_y > 0.01
