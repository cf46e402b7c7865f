# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Exports of testing machines, in the habits of many programs, are read right or questions are asked.

The files of the folder ``measurements`` have made-up numbers: three times 0 to 8 mm in steps of
0.26667 mm and back.  What is expected was taken from them by eye.
"""

from dataclasses import replace
from pathlib import Path
import re

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.lab.analysis.curves import read_curves
from soft_continuum.lab.analysis.delimited import (
    _decimal,
    _unit,
    Column,
    MeasurementError,
    Quantity,
)
from support.curve_files import read, refused

FILES = Path(__file__).parent / 'measurements'
BENT = (0.576, 0.0212, 0.0788)  # N at 8, 0.26667 and 1.06667 mm
STRAIGHT = (0.576, 0.0192, 0.0768)
READ = {
    'c01_wavematrix.csv': BENT, 'c01b_wavematrix_linear.csv': BENT, 'c01c_cycle_time.csv': BENT,
    'c02_us_units.csv': BENT, 'c05_results_first.csv': BENT, 'c05b_results_first_units.csv': BENT,
    'c06_quoted_decimal_commas.csv': BENT, 'c06b_quoted_decimal_commas_5.csv': BENT,
    'c06c_force_4_decimals.csv': BENT, 'c07_nbsp.csv': BENT, 'c07b_nbsp_latin1.csv': BENT,
    'c10_mts_blocks.txt': BENT, 'c10b_stacked_specimens.csv': BENT, 'c11_utf16_nobom.csv': BENT,
    'c11b_spaces.txt': BENT, 'c11c_thousands.csv': BENT, 'c11d_mixed_thousands.csv': BENT,
    'c11e_semicolon_intthousands.csv': BENT, 'c13_wrapped_header.csv': STRAIGHT,
    'c14_footer.csv': STRAIGHT, 'c15_kgf.csv': STRAIGHT, 'c15b_newton_word.csv': STRAIGHT,
    'c18_partial_last_cycle.csv': STRAIGHT,
}
ASKED = {
    'c08_two_sensors.csv': "'Standardweg [mm]', 'Traversenweg [mm]'; name it with "
                           '--displacement-column',
    'c08b_two_sensors_one.csv': "'Displacement [mm]', 'Crosshead [mm]'; name it with "
                                '--displacement-column',
    'c12_motive.csv': '`soft_continuum measure` writes points and pulls',
    'c17_missing_cells.csv': "line 2: Force [N] is '', not a finite number",
}


def test_no_file_is_forgotten():
    assert {path.name for path in FILES.iterdir()} == {*READ, *ASKED}


@pytest.mark.parametrize('name', READ)
def test_exports_are_read(name):
    curves = read_curves([FILES / name])
    assert len(curves) == 3
    for curve in curves:
        u, f = curve.loading
        # Some programs round to a micrometre and a millinewton.
        for displacement, force in zip((8e-3, 0.26667e-3, 1.06667e-3), READ[name], strict=True):
            row = np.argmin(np.abs(u - displacement))
            assert u[row] == pytest.approx(displacement, abs=0.6e-6)
            assert f[row] == pytest.approx(force, abs=0.6e-3)


@pytest.mark.parametrize('name', ASKED)
def test_what_is_not_said_is_asked(name):
    with pytest.raises(MeasurementError, match=re.escape(ASKED[name])):
        read_curves([FILES / name])


def test_one_number_without_a_mark_settles_none_of_the_others():
    refused("'1.234', which may be 1.234 or 1234: .*--decimal", 'Weg [um];Kraft [N]\n1.234;0\n'
            + '\n'.join(f'{12345 + i};{i}' for i in range(20)))
    curve, = read('Weg [um];Kraft [N]\n' + '\n'.join(f'{1 + i}.000;{i}' for i in range(12))
                  + '\n13000;12')
    assert curve.displacement == pytest.approx(1e-3 * np.arange(1, 14))


def test_a_force_that_falls_when_a_specimen_breaks_is_asked_for():
    refused("'1.067', which may be 1.067 or 1067",
            'Weg [mm];Kraft [N]\n1;800\n2;933\n3;1.067\n4;1.012\n')


def test_a_header_on_every_page_makes_no_repetitions():
    header, *rows = table('Weg [mm];Kraft [N]', lambda u, f: f'{u:.2f};{f:.2f}').splitlines()
    curve, = read('\n'.join([header, *rows[:12], 'Page 2', '', header, *rows[12:]]))
    assert curve.force == pytest.approx(FORCE)


@pytest.mark.parametrize('labelled', [False, True])
@pytest.mark.parametrize('back', [False, True])
@pytest.mark.parametrize('starts', [(50, 54, 58), (50, 55, 51), (50, 58, 66), (50, 60, 70)])
def test_specimens_at_other_positions_of_the_machine_are_repetitions(starts, back, labelled):
    header = 'Specimen,Displacement [mm],Force [N]\n'
    steps = [*range(30), *range(28, -1, -1)] if back else range(30)
    blocks = [''.join(f'{k},{start + 0.27 * i:.2f},{0.02 * i:.2f}\n' for i in steps)
              for k, start in enumerate(starts)]
    curves = read(header + ('' if labelled else header).join(blocks))
    assert [len(curve.force) for curve in curves] == [len(steps)] * 3
    for curve, start in zip(curves, starts, strict=True):
        assert curve.loading[0] == pytest.approx(UP + 1e-3 * start)
        assert curve.loading[1] == pytest.approx(FORCE)


def test_the_sensor_that_is_named_is_read():
    curves = read_curves([FILES / 'c08_two_sensors.csv'],
                         {'displacement': 'Traversenweg [mm]', 'force': 'Kraft Sensor 2'})
    assert len(curves) == 3
    assert curves[0].displacement[1] == pytest.approx(0.29333e-3)
    assert curves[0].force[1] == pytest.approx(0.03392)


UP = 0.27e-3 * np.arange(30)  # m
FORCE = 0.02 * np.arange(30)  # N


def comma(value, decimals=2):
    return f'{value:.{decimals}f}'.replace('.', ',')


def grouped(value, by, decimals=0, mark=','):
    return f'{value:,.{decimals}f}'.replace('.', '#').replace(',', by).replace('#', mark)


def table(header, row, count=30):
    """Return a file: a header, and rows of displacement in mm and force in N."""
    return header + '\n' + '\n'.join(row(0.27 * i, 0.02 * i) for i in range(count))


SAME = {
    'no-break blanks, true minus': table(
        'Weg [\u00b5m];Kraft [N]',
        lambda u, f: f'{grouped(-1e3 * u, chr(0x2009), 1).replace("-", chr(0x2212))};{comma(-f)}'),
    'apostrophes': table('Weg [um];Kraft [mN]',
                         lambda u, f: f"{grouped(1e3 * u, chr(39), 2, '.')};{1e3 * f:.0f}"),
    'typographic apostrophes': table(
        'Weg [um];Kraft [mN]', lambda u, f: f'{grouped(1e3 * u, chr(0x2019))};{1e3 * f:.0f}'),
    'points as thousands': table(
        'Weg [um];Kraft [mN]', lambda u, f: f'{grouped(1e3 * u, ".")};{1e3 * f:.0f}'),
    'points as thousands, commas between the columns': table(
        'Weg [um],Kraft [mN]', lambda u, f: f'{grouped(1e3 * u, ".")},{1e3 * f:.0f}'),
    'words of a motion-capture program in a title': 'Project,Rigid Body arm\n' + table(
        'Displacement [mm],Force [N]', lambda u, f: f'{u:.2f},{f:.2f}'),
    'per cent in a column that nobody needs': table(
        'Strain [%];Displacement [mm];Force [N]', lambda u, f: f'{u:.1f} %;{u:.2f};{f:.2f}'),
    'empty columns': table('Displacement [mm],Force [N],,,', lambda u, f: f'{u:.2f},{f:.2f},,,'),
    'empty columns in the header': table('Displacement [mm],Force [N],,',
                                         lambda u, f: f'{u:.2f},{f:.2f}'),
    'a byte order mark and tabs': '\ufeff' + table('Weg [mm]\tKraft [N]',
                                                   lambda u, f: f'{u:.2f}\t{f:.2f}'),
    'UTF-16 without a mark': table('Weg [mm];Kraft [N]', lambda u, f: f'{u:.2f};{f:.2f}').encode(
        'utf-16-be'),
    'cells of the header over lines': table(
        '"Displacement\r\n(actual)\r\n[mm]","Force\r\n[N]"', lambda u, f: f'"{u:.2f}","{f:.2f}"'),
    'a row of units in brackets, an unknown one': table(
        'Time,Displacement,Force,Slip\n[s],[mm],[N],[furlong]',
        lambda u, f: f'0,{u:.2f},{f:.2f},x'),
    'words between header and units': table(
        'Displacement,Force\nActual,Actual\nmm,N', lambda u, f: f'{u:.2f},{f:.2f}'),
    'names over two rows': table(
        'Axial,Axial\nDisplacement,Force\nmm,N', lambda u, f: f'{u:.2f},{f:.2f}'),
    'a channel in brackets behind the unit': table(
        'Displacement (mm) (crosshead),Force (N) (filtered 10 Hz)',
        lambda u, f: f'{u:.2f},{f:.2f}'),
    'units behind a comma': table('"Displacement, mm","Force, N"',
                                  lambda u, f: f'{u:.2f},{f:.2f}'),
    'the time of day': table('Time,Displacement [mm],Force [N]',
                             lambda u, f: f'12:00:01,{u:.2f},{f:.2f}'),
    'a line for spreadsheets': 'sep=;\n' + table('Weg [mm];Kraft [N]',
                                                 lambda u, f: f'{comma(u)};{comma(f)}'),
    'exponents': table('Weg [mm];Kraft [N]', lambda u, f: f'{u:.3E};{f:.3E}'),
    'capital units': table('Weg [MM];Kraft [KN]', lambda u, f: f'{u:.2f};{1e-3 * f:.5f}'),
    'inches and pounds in words': table(
        'Displacement (Inches),Force (Pound-force)',
        lambda u, f: f'{u / 25.4:.6f},{f / 4.4482216:.6f}'),
    'single blanks': table('Displacement_mm Force_N', lambda u, f: f'{u:.2f} {f:.2f}'),
    'results below': table('Weg [mm];Kraft [N]', lambda u, f: f'{u:.2f};{f:.2f}')
                     + '\n\nMaximum;8.0\nMean;0.3;;;',
    'three decimals, and commas as separators': table(
        'Displacement [mm],Force [N]', lambda u, f: f'{u:.3f},{f:.3f}'),
    'results below the time of day': table(
        'Time of day,Displacement [mm],Force [N]', lambda u, f: f'10:00:{u:04.1f},{u:.2f},{f:.2f}'
    ) + '\nMean,4.0,0.29\nCount,30,30',
    'results below numbered points': table(
        'Point;Weg [mm];Kraft [N]', lambda u, f: f'P{u:.0f};{u:.2f};{f:.2f}') + '\nn;30;30',
    'results below nothing': table(
        ',Displacement [mm],Force [N]', lambda u, f: f',{u:.2f},{f:.2f}') + '\nCount,30,30',
    'columns with units of other quantities': table(
        'Time under load [s],Displacement [mm],Force [N],Extension [%],Force [V],Position [count]',
        lambda u, f: f'0,{u:.2f},{f:.2f},{u:.2f},{f:.2f},{u:.0f}'),
    'such units in a row of their own': table(
        'Extension,Load,Extension\n%,N,mm', lambda u, f: f'{u:.2f},{f:.2f},{u:.2f}'),
    'a time of each column, the same': table(
        'Time (s),Force (N),Time (s),Displacement (mm)',
        lambda u, f: f'{u:.2f},{f:.2f},{u:.3f},{u:.2f}'),
    **{f'a unit in {header}': table(f'Displacement{header},Force{header}'.replace(
        'X', 'mm', 1).replace('X', 'N'), lambda u, f: f'{u:.2f},{f:.2f}')
       for header in ('_X_', '..X.', ' {X}', ' <X>', ' [in X]', ' (unit: X)', ' (unit:X)')},
    'a header that numpy.savetxt wrote': table(
        '# time_s displacement_mm force_N', lambda u, f: f'{u:.2e} {u:.2e} {f:.2e}'),
    'comments of MATLAB': table('% Time Displacement Force\n% s mm N',
                                lambda u, f: f'{u:.2f} {u:.2f} {f:.2f}'),
    'points numbered below #': table('# Displacement_mm Force_N',
                                     lambda u, f: f'{u:.2f} {u:.2f} {f:.2f}'),
    'a line below the header': table('Displacement  Force\n  mm  N\n----  -----',
                                     lambda u, f: f'{u:.2f}  {f:.2f}'),
    'comments between the rows': table(
        '# Displacement,Force\n# mm,N',
        lambda u, f: f'{u:.2f},{f:.2f}' + '\n# paused, by 1 operator\n# 5,9' * (u == 2.7)),
    'labels like comments': table('Specimen,Displacement [mm],Force [N]',
                                  lambda u, f: f'# 1,{u:.2f},{f:.2f}'),
    'a byte order mark where files were joined': table(
        '\ufeffWeg [mm];Kraft [N]',
        lambda u, f: '\ufeffWeg [mm];Kraft [N]\n' * (u == 2.7) + f'{u:.2f};{f:.2f}'),
    'a second side that was not measured': table(
        'Weg [mm];Kraft [N];Weg [mm];Kraft [N]', lambda u, f: f'{u:.2f};{f:.2f};;'),
    'all above one, but the time has decimal commas': table(
        'Zeit [s];Weg [um];Kraft [mN]', lambda u, f: f'{comma(u)};{1e3 * u:.0f};{1e3 * f:.0f}'),
}


@pytest.mark.parametrize('habit', SAME)
def test_habits_of_programs_give_the_same_curve(habit):
    curve, = read(SAME[habit])
    assert curve.displacement == pytest.approx(UP, abs=1e-7)
    assert curve.force == pytest.approx(FORCE, abs=1e-5)


def test_numbers_of_samples_before_whole_numbers_are_no_halves_of_others():
    curve, = read(table('Sample,Weg [um],Kraft [mN]',
                        lambda u, f: f'001,{1e3 * u:.0f},{1e3 * f:.0f}'))
    assert curve.displacement == pytest.approx(UP, abs=1e-6)


@pytest.mark.parametrize(('text', 'message'), [
    (table('Weg [mm],Kraft [N]', lambda u, f: f'"{comma(u + 1, 3)}","{comma(f + 1, 3)}"'),
     r"line 2: Kraft \[N\] is '1,000', which may be 1000 or 1: .* --decimal \. or --decimal ,"),
    (table('Weg [mm];Kraft [N]', lambda u, f: f'{u + 1.234:.3f};{f + 1:.3f}'),
     r"line 2: Kraft \[N\] is '1.000', which may be 1 or 1000: .* --decimal"),
    (table('Weg [mm],Kraft [N],Note,Nr', lambda u, f: f'{comma(u, 3)},{comma(f, 3)}'),
     r"line 2: '000' may be the end of another number; decimal commas need semicolons"),
    (table('Zeit [s],Weg [mm],Kraft [N],Temperatur,Feuchte,Nr',
           lambda u, f: f'{comma(u, 1)},{comma(u, 1)},{comma(f, 3)}'),
     "line 2: '000' may be the end of another number; decimal commas need semicolons"),
    *((table(f'Displacement [mm],{header}', lambda u, f: f'{u:.2f},{f:.2f}'),
       'may hold other numbers than its unit says; export it unscaled, or give --force-unit')
      for header in ('Force (x10) [N]', 'Force*100 [N]', 'Force/2 [N]', '1000 * Force [N]',
                     'log Force [N]', 'Force^2 [N]', 'Force (divided by 10) [N]')),
    (table('Displacement [mm],Force (lbf) / N', lambda u, f: f'{u:.2f},{f:.2f}'),
     'is in lbf by its header and in N by its end; give --force-unit'),
    *((table('Displacement [mm],Force [N]', lambda u, f: f'{u:.2f},{f:.2f}').replace(
        f'\n{row}', f'\n{wrong}'), message) for row, wrong, message in (
            ('2.70,0.20', '2.70,9.9E37', r'line 12: Force \[N\] is .9.9E37., far from the rows'),
            ('2.70,0.20', '-999,0.20', 'line 12: Displacement .* far from the rows before and af'),
            ('7.02,0.52', '0,0', 'line 28: Displacement .* far from the rows before and after'),
            ('7.83,0.58', '7.83,9.99', 'line 31: displacement or force is far from the other'),
            ('0.00,0.00', '-999,-999', 'line 2: displacement or force is far from the other'),
            ('2.70,0.20\n2.97,0.22', '2.70,99\n2.97,99', 'line 12: displacement or force is f'))),
    (table('Weg [mm];Kraft [N]', lambda u, f: f'1.23.4;{comma(f)}'),
     r"line 2: Weg \[mm\] is '1.23.4', not a finite number with a decimal comma"),
    (table('Weg [mm];Kraft [N]', lambda u, f: f'1 2;{comma(f)}'), "line 2: .* is '1 2', not a"),
    (table('Weg [mm];Kraft [N]', lambda u, f: f'{u:.2f};{f:.2f}') + '\n7.9', "line 32: .* is ''"),
    (table('Weg [mm];Kraft [N]', lambda u, f: f'{u:.2f};{f:.2f}') + '\nNaN;NaN', 'line 32: .*N'),
    (table('Weg [mm],Kraft [N],Note', lambda u, f: f'{u:.2f},{f:.2f},"x' if u in (0.27, 0.54)
           else f'{u:.2f},{f:.2f},'), 'line 3: a quoted cell continues in the next line'),
    (table('Weg 1 [mm];Kraft 1 [N];Weg 2 [mm];Kraft 2 [N]',
           lambda u, f: f'{u:.2f};{f:.2f};{u:.2f};{f:.2f}'), '2 columns may be the displacement'),
    (table('Load (N),Load cell 2 (N),Extension (mm)', lambda u, f: f'{f:.2f},{f:.2f},{u:.2f}'),
     "2 columns may be the force: 'Load .N.', 'Load cell 2 .N.'; name it with --force-column"),
    (table('Weg;Kraft\nmm;N', lambda u, f: f'{u:.2f};{f:.2f}') + '\n\n'
     + table('Weg;Kraft\nmm;kN', lambda u, f: f'{u:.2f};{f:.2f}'), 'lines 34 and 1: two tables'),
    (table('Displacement [mm],Force [%]', lambda u, f: f'{u:.2f},{f:.2f}'), "'%' is not a unit"),
    (table('Extension ("),Load (lbf)', lambda u, f: f'{u:.2f},{f:.2f}'), 'line 1: .* not a unit'),
    (table('Displacement (link),Force (N)', lambda u, f: f'{u:.2f},{f:.2f}'), "'link' is not a"),
    (table('Uhrzeit;Weg [mm];Kraft [N]',
           lambda u, f: f'10.15;{comma(u + 1, 3)};{comma(f + 1, 3)}'),
     r"line 2: Kraft \[N\] is '1,000', which may be 1000 or 1: .* --decimal"),
    (table('Displacement;Force [N]\nmm;kN', lambda u, f: f'{u:.2f};{f:.2f}'),
     'is in N by its header and in kN by the row of units; give --force-unit'),
    (table('Weg [mm];Kraft [N]', lambda u, f: f'{comma(u, 3)};{comma(f)}').replace(
        '5,400;', '5.400;'),
     r"line 22: Weg \[mm\] is '5.400', which is 5400 .*: correct it, or give --decimal , if"),
    (table('Time [s],Weg [mm],Kraft [N]\n1,2,3', lambda u, f: f'{u:.2f},{u:.2f},{f:.2f}'),
     'line 2: the cells, 1, 2, 3, may be the numbers of the columns; delete this line, or write '
     '1.0 if'),
    (table('Weg [mm];Kraft [N]\n0;1', lambda u, f: f'{u:.2f};{f:.2f}'), 'line 2: the cells, 0, 1'),
    (table('Time [s],Weg [mm],Kraft [N]\nScale,1.0,2.0', lambda u, f: f'0,{u:.2f},{f:.2f}'),
     "line 2: 'Scale' stands where the rows below have a number; delete this line"),
    (table('Time [s],Force [N],Time [s],Displacement [mm]',
           lambda u, f: f'{u:.2f},{f:.2f},{0.8 * u:.2f},{u:.2f}'),
     r'line 3: Force \[N\] was taken at 0.27 and Displacement \[mm\] at 0.22; export both'),
    (table('Weg [%];Kraft [N];Weg [V]', lambda u, f: f'{u:.2f};{f:.2f};{u:.2f}'), "'%' is not a"),
    (table('0.00;1,0', lambda u, f: f'{comma(u)};{comma(f)}'),
     'line 1: the file begins with numbers; write a header line above them that names force and'),
    *((text, '`soft_continuum measure` writes points') for text in (
        'Format Version\t1.23\nFrame\tX\tZ\n0\t1.0\t2.0\n',
        ';Type;Rigid Body;Rigid Body\nFrame;X;Z\n0;1,0;2,0\n',
        '"Trajectories"\n"100"\n"Frame","Sub Frame","X","Y"\n1,0,1,2\n')),
    ('Trajectories\n100\n,,arm:D0,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,0,0,0\n',
     '`soft_continuum measure` writes points'),
    (table('Time  Displacement_mm  Force_N', lambda u, f: f'0  {u:.2f}  {f or "":.3}'),
     'line 2: 2 cells separated by blanks, but the header has 3'),
])
def test_what_may_be_read_in_two_ways_is_refused(text, message):
    refused(message, text)


def whole_or_three(value):
    """Return a number as programs do that drop decimals of whole numbers alone."""
    return f'{value:.3f}'.removesuffix('.000')


@pytest.mark.parametrize('step', [0.11, 0.125, 0.25, 0.5, 1.1, 1.5])
@pytest.mark.parametrize('mark', '.,')
def test_decimals_that_whole_numbers_lack_are_asked_for(step, mark):
    """1, 1.110, 1.220, ...: by their trailing zeros these would be thousands."""
    text = 'Displacement [mm];Force [mN]\n' + '\n'.join(
        f'{whole_or_three(1 + step * k).replace(".", mark)};{72 + 8 * k}' for k in range(31))
    refused(re.escape(f'--decimal {mark}'), text)
    curve, = read(text, decimal=mark)
    assert curve.displacement == pytest.approx(1e-3 * (1 + step * np.arange(31)), abs=1e-6)


def test_the_same_in_a_column_that_nobody_needs_proves_nothing():
    refused('which may be 1.234 or 1234', 'Time;Displacement [mm];Force [mN]\n' + '\n'.join(
        f'{whole_or_three(1 + 0.11 * k)};{1.234 + 1.001 * k:.3f};{72 + 8 * k}' for k in range(31)))


@pytest.mark.parametrize('rounds', [1, 2])
def test_thousands_behind_numbers_below_a_thousand_are_read(rounds):
    curves = read('Weg [um];Kraft [mN]\n' + '\n'.join(
        f'{grouped(200 * k, ".")};{72 + 8 * k}' for _ in range(rounds) for k in range(21)))
    assert len(curves) == rounds
    assert curves[-1].displacement == pytest.approx(2e-4 * np.arange(21))


def test_the_decimal_mark_can_be_given():
    text = table('Weg [mm];Kraft [N]', lambda u, f: f'{u + 1.234:.3f};{f + 1:.3f}')
    assert read(text, decimal='.')[0].force == pytest.approx(FORCE + 1.0)
    assert read(text, decimal=',')[0].force == pytest.approx(1e3 * (FORCE + 1.0))


def two_cells(*head):
    """Return a file of two channels each: force 0.02 and 0.032 N a step, 0.27 and 0.3 mm."""
    return '\n'.join([*head, *(
        f'{i};{0.02 * i:.4f};{0.27 * i:.4f};{0.032 * i:.4f};{0.3 * i:.4f}' for i in range(30))])


CHANNELS = ';Cell 1;Crosshead;Cell 2;Extensometer'
HEADER, UNITS = 'Time;Force;Displacement;Force;Displacement', 's;N;mm;N;mm'
BRACKETED = 'Time;Force [N];Displacement [mm];Force [N];Displacement [mm]'
CALLED = {
    'between header and units': (HEADER, CHANNELS, UNITS),
    'above the header': (CHANNELS, HEADER, UNITS),
    'below numbers over each': (';12;;13', ';Cell 1;;Cell 2', HEADER, UNITS),
    'probes, which are sensors': (';Probe 1;;Probe 2', HEADER, UNITS),
    'of one run': (';Test 1 (cell A);;Test 1 (cell B)', HEADER, UNITS),
    'numbered behind a word': ('Sensor;1;;2', HEADER, UNITS),
    'of one specimen, and units': ('Specimen 1;;;Specimen 2', HEADER, 's;N;mm;mN;mm'),
    'above a header with units': (CHANNELS, BRACKETED),
    'between header and numbers': (BRACKETED, CHANNELS),
    'over the first column of each': (';Cell 1;;Cell 2;', HEADER, UNITS),
    'above and below': (CHANNELS, HEADER, ';Actual;Actual;Actual;Actual', UNITS),
    'of one alone': (HEADER, ';;;Reference;', UNITS),
    'in a header of their own': (
        'Time;Force 1;Displacement 1;Force 2;Displacement 2', HEADER, UNITS),
    'by their units': (HEADER, 's;N;mm;mN;mm'),
}


@pytest.mark.parametrize('head', CALLED.values(), ids=CALLED)
def test_channels_named_in_a_row_of_their_own_are_asked_for(head):
    refused(r'a.csv, line \d: .* may be several channels: give the numbers of the columns, '
            '--displacement-column 3 or 5 and --force-column 2 or 4; if they are repetitions',
            two_cells('Test report', *head))


def test_channels_named_above_columns_that_blanks_separate_are_asked_for():
    refused(r"line 1: .*'Cell 1'.*'Cell 2'.*--force-column 1", 'Cell 1   Cell 2\n' + table(
        'Force [N]  Displacement [mm]  Force [N]  Displacement [mm]',
        lambda u, f: f'{f:.2f}  {u:.2f}  {f:.2f}  {u:.2f}'))


GERMAN = 'Zeit;Kraft;Weg;Kraft;Weg'


@pytest.mark.parametrize('head', [
    ('Specimen 1;;;Specimen 2', 'Thickness;2,1;;2,2', HEADER, UNITS),
    (';1 _ 1;;1 _ 2;', HEADER, UNITS), (';Sample A;;Sample B', BRACKETED),
    (';1;;2', HEADER, UNITS), (';No. 1;;No. 2', HEADER, UNITS),
    (';Probe Nr. 1;;Probe Nr. 2', GERMAN, UNITS), (';Test 1;Test 1;Test 2;Test 2', HEADER, UNITS),
    ('Specimen;soft;;softer', HEADER, UNITS), (HEADER, ';Run 1;;Run 2', UNITS),
    (HEADER, UNITS), (BRACKETED,), ('Test report', 'Operator;NN', HEADER, UNITS),
    ('Raw;Raw;Raw;Raw;Raw', HEADER, ';Actual;Actual;Actual;Actual', UNITS)])
def test_repetitions_side_by_side_called_the_same_or_as_specimens_are_read(head):
    first, second = read(two_cells(*head))
    assert first.force == pytest.approx(FORCE)
    assert second.displacement == pytest.approx(0.3e-3 * np.arange(30))


def test_names_above_sides_of_other_lengths_are_those_of_specimens():
    whole = two_cells(';soft, first;;soft, second', HEADER, UNITS)
    shorter = re.sub(r'(\n2[5-9];[^;]*;[^;]*);.*', r'\1;;', whole)
    assert [len(curve.force) for curve in read(shorter)] == [30, 25]
    refused("'soft, first', 'soft, second'.*call them Specimen 1, Specimen 2 there", whole)
    refused("'Cell 1', 'Crosshead'", shorter.replace('soft, first;;', 'Cell 1;Crosshead;'))


@pytest.mark.parametrize('columns', [
    {'force': '4', 'displacement': '5'}, {'force': 'Cell 2', 'displacement': 'Extensometer'}])
@pytest.mark.parametrize('head', [(HEADER, CHANNELS, UNITS), (CHANNELS, HEADER, UNITS)])
def test_one_of_the_channels_can_be_named(head, columns):
    curve, = read(two_cells('Test report', *head), columns)
    assert curve.force == pytest.approx(0.032 * np.arange(30))
    assert curve.displacement == pytest.approx(0.3e-3 * np.arange(30))
    # Of the other quantity is asked which column.
    refused('2 columns may be the displacement', two_cells(HEADER, CHANNELS, UNITS),
            {'force': columns['force']})


def test_of_columns_with_one_name_the_number_chooses():
    text = table('Force [N];Weg [mm];Force [N]', lambda u, f: f'{f:.2f};{u:.2f};{2 * f:.2f}')
    refused(re.escape("2 columns may be the force: 'Force [N]' (column 1), 'Force [N]' (column 3);"
                      ' name it with --force-column, by its number'), text)
    assert read(text, {'force': '3'})[0].force == pytest.approx(2 * FORCE)
    text = table('Note;of;a test\nSignal;Signal;Signal\nN;mm;N',
                 lambda u, f: f'{10 * f:.1f};{u:.2f};{2 * f:.2f}')
    curve, = read(text, {'force': '3', 'displacement': '2'})
    assert curve.force == pytest.approx(2 * FORCE)
    assert curve.displacement == pytest.approx(UP)
    refused('no column for force', text, {'force': '4', 'displacement': '2'})


@given(values=st.lists(st.integers(0, 10_000_000), min_size=2, max_size=20),
       decimals=st.integers(0, 4), mark=st.sampled_from('.,'),
       by=st.sampled_from(('', 'other', ' ', '\u202f', '\u00a0', "'")), quoted=st.booleans())
def test_no_number_is_read_a_thousand_times_too_large(values, decimals, mark, by, quoted):
    """However a column was written: it is read as it was meant, or the mark is asked for."""
    other = {'.': ',', ',': '.'}[mark]
    numbers = [value / 10**decimals for value in values]
    cells = tuple(grouped(number, other if by == 'other' else by, decimals, mark)
                  for number in numbers)
    column = Column(Quantity('u', ('u',)), Path('a.csv'), 'u', 1.0, cells,
                    tuple(range(len(cells))), 1)
    # Programs that separate columns by commas write points, unless they quote.
    quoted |= mark == ',' or by == 'other'
    try:
        decimal = _decimal([column], ';' if quoted else ',', [cells])
    except MeasurementError as error:
        assert '--decimal' in str(error)
        return
    assert replace(column, decimal=decimal).numbers() == pytest.approx(np.array(numbers))


@pytest.mark.parametrize(('unit', 'factor', 'of'), [
    ('in', 0.0254, 'm'), ('inches', 0.0254, 'm'), ('ft', 0.3048, 'm'), ('mm', 1e-3, 'm'),
    ('\u00b5m', 1e-6, 'm'), ('\u03bcm', 1e-6, 'm'), ('Millimeters', 1e-3, 'm'),
    ('lbf', 4.4482216152605, 'N'), ('kgf', 9.80665, 'N'), ('gf', 9.80665e-3, 'N'),
    ('kN', 1e3, 'N'), ('mN', 1e-3, 'N'), ('daN', 10.0, 'N'), ('Newtons', 1.0, 'N'),
    ('deg', np.pi / 180, 'rad'), ('\u00b0', np.pi / 180, 'rad'), ('g', 1e-3, 'kg'),
])
def test_units_are_those_of_the_tables_of_nist(unit, factor, of):
    found = _unit(unit)
    assert found is not None
    assert found[0] == pytest.approx(factor)
    assert found[1] == _unit(of)[1]


@pytest.mark.parametrize('word', ['', 'link', 'rod', 'hand', 'Grad', '%', 'MN', '9**9', 'actual',
                                  'N/mm', 'stone', 'x', 'Nm'])
def test_other_words_are_no_units(word):
    assert _unit(word) is None
