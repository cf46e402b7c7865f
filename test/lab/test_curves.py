# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Force-displacement files are read as machines write them, or refused with file and line."""

import numpy as np
import pytest

from soft_continuum.lab.analysis.characterisation import regress
from soft_continuum.lab.analysis.curves import read_curves
from soft_continuum.lab.analysis.delimited import MeasurementError
from support import curve_files as files

UP = files.ramp(points=21)
FORCE = files.SLOPE * UP


@pytest.mark.parametrize(('header', 'delimiter', 'decimal', 'factors'), [
    ('displacement [mm],force [N]', ',', '.', (1e3, 1.0)),
    ('Standardweg [mm];Standardkraft [N]', ';', ',', (1e3, 1.0)),
    ('Weg in mm\tKraft in N', '\t', ',', (1e3, 1.0)),
    ('Crosshead travel (m);Load (mN)', ';', '.', (1.0, 1e3)),
    ('u / mm;F / kN', ';', ',', (1e3, 1e-3)),
    ('displacement_mm,force_N', ',', '.', (1e3, 1.0)),
    ('Traversenweg;Kraft\nmm;N', ';', ',', (1e3, 1.0)),
    ('"Weg [mm]";"Kraft [N]"', ';', ',', (1e3, 1.0)),
    ('Verformung [\u00b5m];Kraft [cN];', ';', ',', (1e6, 1e2)),
])
@pytest.mark.parametrize('preamble', [(), ('Test report', '', 'Operator;NN', 'Speed;0,1;mm/s')])
def test_usual_exports_give_the_same_curve(tmp_path, header, delimiter, decimal, factors,
                                           preamble):
    path = files.export(tmp_path / 'a.csv', [(UP, FORCE)], header, delimiter, decimal, preamble,
                        factors)
    curve, = read_curves([path])
    assert curve.displacement == pytest.approx(UP)
    assert curve.force == pytest.approx(FORCE)


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'utf-16', 'cp1252'])
def test_every_usual_encoding_is_read(tmp_path, encoding):
    path = files.export(tmp_path / 'a.csv', [(UP, FORCE)], preamble=('Pr\u00fcfung',),
                        encoding=encoding)
    assert read_curves([path])[0].force == pytest.approx(FORCE)


def test_thousands_are_not_taken_for_decimals():
    rows = [f'{i};1.{i:03d},5' for i in range(20)]
    curve, = files.read('Weg [mm];Kraft [mN]\n' + '\n'.join(rows))
    assert curve.force == pytest.approx(1.0005 + 1e-3 * np.arange(20))


def test_a_unit_that_the_header_lacks_can_be_given(tmp_path):
    path = files.export(tmp_path / 'a.csv', [(UP, FORCE)], 'displacement,force')
    with pytest.raises(MeasurementError, match=r"a\.csv, line 1: column 'force' has no unit"):
        read_curves([path], units={'displacement': 'mm'})
    curve, = read_curves([path], units={'displacement': 'mm', 'force': 'N'})
    assert curve.force == pytest.approx(FORCE)


def test_a_column_can_be_named(tmp_path):
    path = files.export(tmp_path / 'a.csv', [(UP, FORCE)], 'Kanal 1 [mm];Kanal 2 [N]', ';')
    with pytest.raises(MeasurementError, match='line 1: .*is a header with columns for force and'):
        read_curves([path])
    curve, = read_curves([path], {'displacement': 'Kanal 1', 'force': 'Kanal 2'})
    assert curve.force == pytest.approx(FORCE)


def test_repetitions_below_one_another_are_told_apart_by_the_displacement(tmp_path):
    down = UP[::-1]
    both = np.concatenate([UP, down])
    path = files.export(tmp_path / 'a.csv', [(UP, FORCE), (both, 60.0 * both), (UP, 2 * FORCE)])
    curves = read_curves([path])
    assert [len(c.loading[0]) for c in curves] == [21, 21, 21]
    assert [len(c.unloading[0]) for c in curves] == [1, 22, 1]
    assert curves[2].force == pytest.approx(2 * FORCE)
    assert [c.name for c in curves] == ['a.csv #1', 'a.csv #2', 'a.csv #3']


def test_noise_of_the_displacement_makes_no_repetitions(tmp_path):
    rng = np.random.default_rng(3)
    path = files.export(tmp_path / 'a.csv', [(UP + rng.normal(0.0, 1e-3, UP.size), FORCE)])
    assert len(read_curves([path])) == 1


def test_a_repetition_column_tells_repetitions_apart():
    rows = [f'{k};{1e3 * u};{f}' for k in 'ab' for u, f in zip(UP, FORCE, strict=True)]
    curves = files.read('Cycle;Weg [mm];Kraft [N]\n' + '\n'.join(rows))
    assert [len(c.force) for c in curves] == [21, 21]


def test_repetitions_side_by_side_may_differ_in_length():
    rows = [f'{1e3 * u};{f};{1e3 * u};{2 * f}' if k < 15 else f'{1e3 * u};{f};;'
            for k, (u, f) in enumerate(zip(UP, FORCE, strict=True))]
    first, second = files.read('Weg [mm];Kraft [N];Weg [mm];Kraft [N]\n' + '\n'.join(rows))
    assert first.force == pytest.approx(FORCE)
    assert second.force == pytest.approx(2 * FORCE[:15])


def test_a_machine_that_counts_downwards_gives_the_same_curve(tmp_path):
    path = files.export(tmp_path / 'a.csv', [(-UP, -FORCE)])
    curve, = read_curves([path])
    assert curve.displacement == pytest.approx(UP)
    assert curve.force == pytest.approx(FORCE)


def loops(*largest, points=20):
    """Return cycles to these displacements (m), with forces (N) that lag on the way back."""
    for top in largest:
        up = np.linspace(0.0, top, points)
        yield up[:-1], files.SLOPE * up[:-1]
        yield up[::-1], files.SLOPE * (up[::-1] - 0.6 * up[::-1] * (1.0 - up[::-1] / top))


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('largest', [(2e-3, 4e-3, 6e-3, 8e-3), (3e-3, 8e-3), (8e-3, 6e-3, 4e-3),
                                     (1e-3, 1e-3, 8e-3, 8e-3), (5e-3, 2.3e-3, 2.4e-3, 5.4e-3)])
def test_loops_that_grow_or_shrink_are_repetitions(tmp_path, largest, sign):
    path = files.export(tmp_path / 'a.csv', [(sign * u, sign * f) for u, f in loops(*largest)])
    curves = read_curves([path])
    assert [curve.displacement.max() for curve in curves] == pytest.approx(largest)
    assert regress(curves).slope == pytest.approx(files.SLOPE)


def test_the_way_back_from_the_other_side_is_no_repetition(tmp_path):
    both = [*loops(8e-3), *((-u, -f) for u, f in loops(8e-3))]
    assert len(read_curves([files.export(tmp_path / 'a.csv', both)])) == 1
    assert len(read_curves([files.export(tmp_path / 'b.csv', [*both, *both])])) == 2


@pytest.mark.parametrize('tail', [(0.3e-3,), (4e-3,)])
def test_a_small_loop_of_few_points_makes_no_repetition(tmp_path, tail):
    path = files.export(tmp_path / 'a.csv', [*loops(8e-3), *loops(*tail, points=6)])
    assert len(read_curves([path])) == 1


@pytest.mark.parametrize('position', [0.1, -0.1, 5e-3, -5e-3])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_positions_of_a_machine_count_in_the_direction_of_the_load(tmp_path, position, sign):
    path = files.export(tmp_path / 'a.csv', [
        (position + sign * u, sign * f) for u, f in loops(8e-3, 8e-3, 8e-3)])
    curves = read_curves([path])
    assert [len(curve.loading[0]) for curve in curves] == [20] * 3
    assert regress(curves).slope == pytest.approx(files.SLOPE)


@pytest.mark.parametrize('label', [
    lambda row: 'A1', lambda row: row // 39, lambda row: row // 78, lambda row: (row + 2) // 39,
    lambda row: (row + 20) // 39 + row // 39])
def test_labels_of_specimens_cycles_and_half_cycles_give_the_same_repetitions(label):
    rows = [(1e3 * u, f) for part in loops(8e-3, 8e-3, 8e-3) for u, f in zip(*part, strict=True)]
    curves = files.read('Cycle;Weg [mm];Kraft [N]\n' + '\n'.join(
        f'{label(k)};{u};{f}' for k, (u, f) in enumerate(rows)))
    assert [len(curve.loading[0]) for curve in curves] == [20] * 3
    assert regress(curves).slope == pytest.approx(files.SLOPE)


HEAD = 'time [s];displacement [mm];force [N]\n'
ROWS = [f'{i};{i};{i}' for i in range(20)]


def with_row(number, row):
    return HEAD + '\n'.join([*ROWS[:number], row, *ROWS[number + 1:]])


@pytest.mark.parametrize(('text', 'message'), [
    ('', r'a\.csv: the file is empty'),
    ('  \n\n', r'a\.csv: the file is empty'),
    (HEAD, r'a\.csv, line 1: there are no rows'),
    ('displacement [mm]|force [N]\n1|2\n', r'line 1: neither .* another delimiter'),
    ('1;2\n3;4\n', r'line 1: .* write a header line above'),
    ('displacement [mm];stress [MPa]\n1;2\n',
     r"line 1: no column for force; .*'stress \[MPa\]'; name it with --force-column"),
    ('displacement [mm];force [stone]\n1;2\n',
     r"line 1: 'stone' is not a unit of force; known: N, .*lbf; give --force-unit"),
    ('displacement [mm];force [kg]\n1;2\n', r"line 1: 'kg' is not a unit of force; known: .*kgf"),
    ('displacement [Grad];force [N]\n1;2\n', r"line 1: 'Grad' is not a unit of displacement"),
    ('displacement [mm];force [mm]\n1;2\n', r"line 1: 'mm' is not a unit of force"),
    (with_row(7, '7;7;NaN'), r"line 9: force \[N\] is 'NaN', not a finite number; delete"),
    (with_row(7, '7;;7'), r"line 9: displacement \[mm\] is '', not a finite"),
    (with_row(7, '7;inf;7'), r"line 9: displacement \[mm\] is 'inf'"),
    (with_row(7, '7;7;7;7'), r'line 9: 4 cells separated by semicolons, but the header has 3'),
    (with_row(7, 'broken;off;here'), 'line 9: .* is .*, not a finite number'),
    (with_row(7, '3;7;7'), r'line 9: time \[s\] steps back from 6 to 3 within a repetition'),
    (with_row(7, '7;7.1;7,1'), r'lines 9 and 9: decimal points and decimal commas'),
    (HEAD + '\n'.join(ROWS[:5]), r'line 2: .* has 5 points .*; 10 or more are needed'),
    ('displacement [mm],force [N]\n1,0,2,0\n',
     r'line 2: 4 cells .* decimal commas need semicolons'),
    (HEAD.replace('time [s]', 'force [N]') + '\n'.join(ROWS),
     r'2 columns may be the force: .*--force-column'),
    (HEAD + '\n'.join(f'{i};{i};1' for i in range(20)), r'line 2: force or displacement does not'),
    (bytes(range(256)) * 4, r'a\.csv: is not a text file; export it as CSV'),
])
def test_bad_files_are_refused_with_file_line_and_remedy(text, message):
    files.refused(message, text)


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(MeasurementError, match='none.csv: cannot be read: No such file'):
        read_curves(['none.csv'])


def test_time_may_start_again_with_every_repetition():
    assert len(files.read(HEAD + '\n'.join(ROWS + ROWS))) == 2


def test_no_damage_to_a_file_ends_in_another_error(tmp_path):
    rng = np.random.default_rng(7)
    path = files.export(tmp_path / 'a.csv', [(UP, FORCE)], 'Weg;Kraft\nmm;N', ';', ',', ('head',))
    source = path.read_text(encoding='utf-8').splitlines()
    scraps = ['"', ';', ',', '\t', 'NaN', '-', '1e999', '\x00', '\u00e4', '\r', '[', '1', '']
    refused = 0
    for _ in range(200):
        lines = list(source)
        for _ in range(rng.integers(4)):
            k = int(rng.integers(len(lines)))
            at = int(rng.integers(len(lines[k]) + 1))
            rest = lines[k][at:] if rng.random() < 0.7 else ''
            lines[k] = lines[k][:at] + scraps[rng.integers(len(scraps))] + rest
        path.write_text('\n'.join(lines), encoding='utf-8')
        try:
            read_curves([path])
        except MeasurementError as error:
            assert str(error).startswith(str(path))
            assert '\n' not in str(error)
            refused += 1
    assert 50 < refused < 190
