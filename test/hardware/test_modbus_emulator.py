# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emulated Modbus boards speak the protocol as it is written, and fail as they are told."""

import os
import tty

import pytest

from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.sim.emulators.modbus import crc, execute_command
from support.modbus_line import emulated, eventually, receive

NO_ANSWER_TIME = 0.5  # s without an answer


@pytest.fixture
def emulator():
    with emulated() as rig:
        yield rig


def ask(emulator, request, size, timeout=20.0):
    """Send the bytes of a request (hex, without checksum); return ``size`` bytes of the answer."""
    return ask_raw(emulator, sealed(request), size, timeout)


def sealed(request):
    data = bytes.fromhex(request)
    return data + crc(data)


def ask_raw(emulator, data, size, timeout=20.0):
    with open_serial(emulator.port, 9600) as line:
        line.write(data)
        reply = receive(emulator, line, size, timeout)
    if len(reply) < 4:
        return reply.hex(' ')
    assert crc(reply[:-2]) == reply[-2:]
    return reply[:-2].hex(' ')


def test_the_checksum_is_that_of_the_standard():
    # The check value of CRC-16/MODBUS.
    assert crc(b'123456789') == bytes([0x37, 0x4B])


def test_coils_are_written_one_by_one_and_read_together(emulator):
    assert ask(emulator, '01 05 0002 FF00', 8) == '01 05 00 02 ff 00'
    assert ask(emulator, '01 05 0000 FF00', 8) == '01 05 00 00 ff 00'
    assert ask(emulator, '01 01 0000 0004', 6) == '01 01 01 05'
    assert ask(emulator, '01 01 0002 0001', 6) == '01 01 01 01'
    assert ask(emulator, '01 05 0000 0000', 8) == '01 05 00 00 00 00'
    assert emulator.coils == (False, False, True, False)


def test_coils_are_written_together(emulator):
    assert ask(emulator, '01 0F 0001 0003 01 05', 8) == '01 0f 00 01 00 03'
    assert emulator.coils == (False, True, False, True)


def test_more_than_eight_coils_are_read_in_the_order_of_the_standard():
    with emulated(12) as emulator:
        assert ask(emulator, '01 0F 0000 000A 02 01 02', 8) == '01 0f 00 00 00 0a'
        assert ask(emulator, '01 01 0000 000D', 7) == '01 01 02 01 02'


def test_currents_are_read_in_microamperes(emulator):
    emulator.segments[1].stuck_at = 20000
    assert ask(emulator, '02 04 0000 0003', 11) == '02 04 06 0f a0 4e 20 0f a0'
    assert ask(emulator, '02 04 0001 0001', 7) == '02 04 02 4e 20'


@pytest.mark.parametrize('request_, code', [
    ('01 03 0000 0001', '83 01'), ('01 04 0000 0001', '84 01'), ('01 08 0000 1234', '88 01'),
    ('01 01 0000 0005', '81 02'), ('01 01 FFFF 0001', '81 02'), ('01 05 0004 FF00', '85 02'),
    ('01 01 0000 0000', '81 03'), ('01 01 0000 07D1', '81 03'), ('01 05 0000 0001', '85 03'),
    ('01 0F 0000 0003 02 0505', '8f 03'), ('01 0F 0003 0002 01 03', '8f 02'),
    ('02 01 0000 0001', '81 01'), ('02 04 0003 0001', '84 02'), ('02 04 0000 007E', '84 03')])
def test_what_the_boards_cannot_do_is_answered_by_the_exception_of_the_standard(
        emulator, request_, code):
    assert ask(emulator, request_, 5) == f'{request_[:2]} {code}'
    assert emulator.coils == (False,) * 4


@pytest.mark.parametrize('data', [
    sealed('03 01 0000 0001'), sealed('01 05 0001 FF00')[:-1] + b'\0', b'\x01', b'\0' * 50])
def test_other_units_and_damaged_requests_are_met_with_silence(emulator, data):
    assert ask_raw(emulator, data, 5, NO_ANSWER_TIME) == ''
    assert emulator.coils == (False,) * 4
    assert ask(emulator, '01 01 0000 0004', 6) == '01 01 01 00'


@pytest.mark.parametrize(('request_', 'reply'), [
    ('03 03 0000 0003', '03 03 06 0f a0 0f a0 0f a0'),  # 4 mA three times
    ('03 06 0001 2EE0', '03 06 00 01 2e e0'),  # 12 mA
    ('03 06 0001 0F9F', '03 86 03'),  # less than 4 mA
    ('03 06 0003 2EE0', '03 86 02'),
    ('03 05 0000 FF00', '03 85 01'),
    ('01 01 0000 0001', ''),  # there is no relay board
])
def test_the_emulated_output_board_answers_as_the_standard_has_it(request_, reply):
    with emulated(regulators=True) as emulator:
        size = len(bytes.fromhex(reply)) + 2
        assert ask(emulator, request_, size if reply else 5, NO_ANSWER_TIME) == reply


def test_requests_that_wait_are_answered_in_their_order(emulator):
    both = sealed('01 05 0001 FF00') + sealed('01 01 0000 0004')
    with open_serial(emulator.port, 9600) as line:
        line.write(both)
        assert receive(emulator, line, 14) == sealed('01 05 0001 FF00') + sealed('01 01 01 02')


def test_the_rig_evacuates_and_vents_as_its_relays_say(emulator):
    ask(emulator, '01 0F 0000 0004 01 05', 8)  # the pump and the valve of segment 2
    eventually(emulator, lambda: emulator.vacuum(1), lambda vacuum: vacuum > 93e3)
    assert emulator.vacuum(0) == emulator.vacuum(2) == 0.0
    ask(emulator, '01 05 0002 0000', 8)
    eventually(emulator, lambda: emulator.vacuum(1), lambda vacuum: vacuum < 1e3)


def test_a_leak_keeps_a_segment_from_its_vacuum():
    with emulated(initially_stiff=True) as emulator:
        execute_command(emulator, 'leak 2 100000')
        eventually(emulator, lambda: emulator.vacuum(1), lambda vacuum: vacuum < 60e3)
        assert emulator.vacuum(0) > 93e3
        execute_command(emulator, 'repair')
        eventually(emulator, lambda: emulator.vacuum(1), lambda vacuum: vacuum > 93e3)


FAULTS = {
    'hang': lambda e: e.hang, 'late 0.5': lambda e: e.late == 0.5,
    'drop 0.1': lambda e: e.drop == 0.1, 'garble 1': lambda e: e.garble == 1.0,
    'echo': lambda e: e.echo, 'zeros 3': lambda e: e.zeros == 3,
    'refuse 6': lambda e: e.refuse == 6, 'stuck-coil 2': lambda e: e.stuck == {2},
    'broken-wire 1': lambda e: e.segments[0].current() == 0,
    'stuck-sensor 3': lambda e: e.segments[2].stuck_at == 4000,
}


@pytest.mark.parametrize('line, present', FAULTS.items(), ids=FAULTS)
def test_every_fault_is_there_when_typed_and_gone_when_repaired(emulator, line, present):
    assert not present(emulator)
    assert execute_command(emulator, line) == 'done'
    assert present(emulator)
    execute_command(emulator, 'repair')
    assert not present(emulator)


def test_a_hung_board_says_nothing(emulator):
    execute_command(emulator, 'hang')
    assert ask(emulator, '01 01 0000 0004', 6, NO_ANSWER_TIME) == ''


def test_noise_is_as_long_as_typed(emulator):
    with open_serial(emulator.port, 9600) as line:
        execute_command(emulator, 'noise 5')
        assert len(receive(emulator, line, 5)) == 5


def test_a_relay_board_that_loses_power_drops_every_relay():
    with emulated(initially_stiff=True) as emulator:
        execute_command(emulator, 'power-cycle')
        assert emulator.coils == (False,) * 4


def test_the_state_says_all_there_is_to_see():
    with emulated(2, initially_stiff=True) as emulator:
        state = execute_command(emulator, 'state')
    assert 'pump on' in state and 'segment 2: valve on, vacuum 94.0 kPa, 19040 uA' in state


def test_nobody_reading_the_line_does_not_block_the_boards(emulator):
    line = os.open(emulator.port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    for _ in range(2000):
        emulator.send(b'\xff' * 100)
    os.close(line)
    with open_serial(emulator.port, 9600) as fresh:
        fresh.timeout = 20.0  # s
        fresh.reset_input_buffer()
    assert emulator.coils == (False,) * 4
