# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Several GRBL boards are one driver, and what one of them does not do stops all."""

from contextlib import contextmanager, ExitStack

import pytest

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.hardware.grbl.tendons import GrblBoards, GrblTendons
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sim.emulators.grbl import GrblEmulator
from support.driver_waits import at_rest, until
from support.grbl_rig import ACCELERATION, driver, SPEED
from support.virtual_clock import VirtualClock

PULLS = (0.002, -0.001, 0.003, 0.004, -0.003)


@contextmanager
def boards(names, changes, options=({}, {})):
    """Two emulated boards and the driver of both, not opened; of each what is not as usual."""
    clock = VirtualClock()
    with ExitStack() as stack:
        emulators = [stack.enter_context(GrblEmulator(clock=clock, **each)) for each in options]
        tendons = GrblBoards([driver(*each, **change) for *each, change in zip(
            emulators, map(tuple, names), changes, strict=True)], clock)
        stack.callback(tendons.close)
        yield emulators, tendons


def two_boards(**changes):
    return boards(('abc', 'de'), (changes, changes))


def test_five_tendons_move_on_two_boards():
    with two_boards() as (emulators, tendons):
        tendons.open()
        assert not tendons.read().referenced
        with pytest.raises(HardwareError, match='position is unknown.* of a, b, c'):
            tendons.move(PULLS, 0.3)
        tendons.reference()
        tendons.move(PULLS, 0.3)
        reading = at_rest(tendons)
        assert reading.referenced
        assert reading.pulls == pytest.approx(PULLS, abs=1e-9)
        assert emulators[0].motors == (400, -200, 600)
        assert emulators[1].motors[:2] == (800, -600)
        with pytest.raises(HardwareError, match='2 pulls were given; .* a, b, c, d, e'):
            tendons.move((0.0, 0.0), 0.3)


def test_when_one_board_fails_the_others_stop():
    with two_boards() as (emulators, tendons):
        tendons.open()
        tendons.reference()
        tendons.move((0.04,) * 5, 2.0)
        until(tendons, lambda: emulators[0].motors[0] > 300, 'in motion')
        emulators[1].unplug()

        def failed():
            try:
                tendons.read()
            except HardwareError as error:
                return 'the controller of d, e' in str(error)
            return False
        until(tendons, failed, 'a HardwareError')
        until(tendons, lambda: not emulators[0].moving, 'at rest')
        assert emulators[0].motors[0] < 7000
        with pytest.raises(HardwareError, match='the controller of d, e'):
            tendons.stop()


def test_boards_are_opened_all_or_none():
    with two_boards() as (emulators, tendons):
        emulators[1].hang = True
        with pytest.raises(HardwareError, match='no GRBL controller answered.*of d, e'):
            tendons.open()
        with pytest.raises(HardwareError, match='configure the node'):
            tendons.read()
        emulators[1].hang = False
        tendons.open()
        assert len(tendons.read().pulls) == 5


def test_a_board_that_cannot_be_opened_for_any_reason_is_not_taken_to_be_open(monkeypatch):
    with two_boards() as (emulators, tendons):
        monkeypatch.setattr(tendons._boards[1], 'open', lambda: [][0])
        with pytest.raises(HardwareError, match='IndexError.*of d, e'):
            tendons.open()
        GrblTendons.open(tendons._boards[0])  # its port is free again


def test_ports_with_spaces_between_share_the_tendons_evenly():
    values = {p.name: p.default for p in GrblTendons.PARAMETERS} | {
        'speed_limit': SPEED, 'acceleration_limit': ACCELERATION, 'pull_limits': (-0.06, 0.06),
        'arm.tendon_names': tuple('abcdefghi'),
        'arm.tendon_angles': tuple(0.6 * k for k in range(9)),
        'grbl.steps_per_mm': (200.0,) * 9, 'grbl.signs': (1.0,) * 8 + (-1.0,)}
    values['grbl.port'] = '/dev/one /dev/two /dev/three'
    assert isinstance(GrblTendons.from_parameters(values, STEADY), GrblBoards)
    (_, first), _, (port, last) = Motors.of_boards(values)
    assert port == '/dev/three'
    assert (first.tendons, last.tendons) == (tuple('abc'), tuple('ghi'))
    assert last.signs == (1.0, 1.0, -1.0)
    for ports, words in (('/dev/one /dev/two', 'the ports of 3 as grbl.port'),
                         (' '.join(map(str, range(10))), '10 ports: too many for 9 tendons')):
        with pytest.raises(ParameterError, match=words):
            GrblTendons.from_parameters(values | {'grbl.port': ports}, STEADY)
    homed = values | {'grbl.port': ' '.join(f'/dev/{k}' for k in range(9))}
    for pulls in ((0.0,), (-0.01,) * 9):
        assert len(Motors.of_boards(homed | {'grbl.homed_pulls': pulls})) == 9
    with pytest.raises(ParameterError, match='homed_pulls .* alone on its board .* below 0'):
        Motors.of_boards(homed | {'grbl.homed_pulls': (-0.01,) * 8 + (0.0,)})


def test_boards_that_accelerate_differently_are_refused_at_the_start():
    with two_boards(acceleration_limit=0.1) as (emulators, tendons):
        emulators[1].firmware.settings |= {120: 20000.0, 121: 20000.0}  # 0.1 m/s^2, in steps/s^2
        with pytest.raises(HardwareError, match=r'11.2 mm/s for d, e; set \$120'):
            tendons.open()
        with pytest.raises(HardwareError, match='configure the node'):
            tendons.read()


def homing_boards():
    """Two boards with limit switches, locked until they are homed."""
    settings = {22: 1, 23: 3, 130: 20000, 131: 20000}
    return boards(
        ('ab', 'cd'), ({'homed_pulls': (-0.011, -0.009)}, {'homed_pulls': (-0.019, -0.014)}),
        ({'settings': settings, 'switches': (-2400.0, -2000.0)},
         {'settings': settings, 'switches': (-4000.0, -3000.0)}))


def test_boards_home_together_and_the_arm_is_referenced_when_the_last_one_is():
    with homing_boards() as (emulators, tendons):
        tendons.open()
        assert tendons.reference_moves
        tendons.reference()
        until(tendons, lambda: tendons._boards[0].read().referenced, 'the first one is homed')
        assert not tendons.read().referenced
        with pytest.raises(HardwareError, match='of c, d'):
            tendons.move((0.001,) * 4, 0.2)
        with pytest.raises(HardwareError, match='are moving'):
            tendons.reference()
        until(tendons, lambda: tendons.read().referenced, 'both are homed')
        assert at_rest(tendons).pulls == (0.0,) * 4
        assert [emulator.motors for emulator in emulators] == [(0, 0, 0), (0, 0, 0)]
        tendons.move((0.004, -0.002, 0.003, 0.0), 0.3)
        assert at_rest(tendons).pulls == pytest.approx((0.004, -0.002, 0.003, 0.0), abs=1e-9)


def test_when_one_board_does_not_find_its_switch_no_tendon_of_another_moves_on():
    with homing_boards() as (emulators, tendons):
        tendons.open()
        emulators[1].alarm(9)
        with pytest.raises(HardwareError):
            tendons.reference()
            until(tendons, lambda: tendons.read().referenced, 'homed')
        until(tendons, lambda: not emulators[0].moving, 'at rest')
        where = emulators[0].motors
        tendons.clock.sleep(1.0)
        assert emulators[0].motors == where
