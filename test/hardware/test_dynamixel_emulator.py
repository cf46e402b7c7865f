# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emulated servos answer the maker's own SDK, and move, as those of the X series do."""

from contextlib import contextmanager
from math import pi

import dynamixel_sdk as sdk
from dynamixel_sdk import protocol2_packet_handler
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.sim.emulators.dynamixel import (
    DynamixelEmulator,
    execute_command,
    main,
    make_servos,
)
from soft_continuum.sim.emulators.dynamixel_models import MODELS
from soft_continuum.sim.emulators.dynamixel_packets import (
    BROADCAST,
    Instruction,
    packet,
    PacketReader,
    status,
)
from soft_continuum.sim.emulators.dynamixel_servo import BOOT_TIME, DynamixelServo, SpringTendon
from support.driver_waits import until
from support.virtual_clock import VirtualClock

TORQUE, MODE, GOAL_CURRENT, GOAL, WATCHDOG, POSITION, ERRORS = 64, 11, 102, 116, 98, 132, 70
PROFILE_ACCELERATION, PROFILE_VELOCITY = 108, 112
LOST = sdk.COMM_RX_TIMEOUT


class Port(sdk.PortHandler):
    """A port of the SDK whose time is that of the emulator, and which waits without a loop."""

    def __init__(self, emulator):
        super().__init__(emulator.port)
        self.clock = emulator.clock

    def getCurrentTime(self):  # noqa: N802
        return 1e3 * self.clock()

    def readPort(self, length):  # noqa: N802
        self.clock.wait([self.ser.fileno()], 0.001)
        return self.ser.read(length)


class Bus:
    """The maker's SDK on the port of an emulator."""

    def __init__(self, emulator, baud_rate=1000000, protocol=2.0):
        self.emulator = emulator
        self.port = Port(emulator)
        self.port.openPort()
        assert self.port.setBaudRate(baud_rate)
        self.handler = sdk.PacketHandler(protocol)

    def read(self, device, address, size=4):
        data, result, error = self.handler.readTxRx(self.port, device, address, size)
        assert (result, error) == (sdk.COMM_SUCCESS, 0)
        return int.from_bytes(bytes(data), 'little', signed=size > 1)

    def write(self, device, address, value, size=4):
        """Write, and return the error of the status packet."""
        result, error = self.handler.writeTxRx(
            self.port, device, address, size, list(value.to_bytes(size, 'little', signed=True)))
        assert result == sdk.COMM_SUCCESS
        return error


@contextmanager
def bus(tendons=2, model='XM430-W350', baud_rate=1000000, protocol=2):
    servos = make_servos(tendons, model)
    for servo in servos:
        servo.values['Protocol Type'] = protocol
    with DynamixelEmulator(servos, clock=VirtualClock()) as emulator:
        made = Bus(emulator, baud_rate)
        yield made
        made.port.closePort()


def run(servo, seconds):
    """Let time pass for a servo that is on no bus."""
    for _ in range(round(seconds / 0.002)):
        servo.advance(0.002)


def put(servo, address, value, size=4):
    error, _ = servo.execute(Instruction.WRITE, address.to_bytes(2, 'little')
                             + value.to_bytes(size, 'little', signed=True))
    return error


def get(servo, address, size=4):
    error, data = servo.execute(Instruction.READ, address.to_bytes(2, 'little')
                                + size.to_bytes(2, 'little'))
    assert not error & 0x7F
    return int.from_bytes(data, 'little', signed=size > 1)


def pulling(current=None, model='XM430-W350', **tendon):
    """A servo in current-based position mode, torque on."""
    servo = DynamixelServo(MODELS[model], tendon=SpringTendon(**tendon))
    assert put(servo, MODE, 5, 1) == 0 and put(servo, TORQUE, 1, 1) == 0
    if current is not None:
        assert put(servo, GOAL_CURRENT, current, 2) == 0
    return servo


# Packets


@pytest.mark.parametrize(('made', 'printed'), [
    (packet(1, 0x01), '01 03 00 01 19 4E'),
    (status(1, 0, b'\x06\x04\x26'), '01 07 00 55 00 06 04 26 65 5D'),
    (packet(1, 0x03, bytes.fromhex('7400 00020000')), '01 09 00 03 74 00 00 02 00 00 CA 89'),
    (packet(1, 0x10, bytes.fromhex('0144584C22')), '01 08 00 10 01 44 58 4C 22 B1 DC'),
    (packet(BROADCAST, 0x82, bytes.fromhex('840004000102')),
     'FE 09 00 82 84 00 04 00 01 02 CE FA'),
])
def test_packets_are_those_that_the_manual_prints(made, printed):
    """https://emanual.robotis.com/docs/en/dxl/protocol2/ ."""
    assert made == bytes.fromhex('FFFFFD00' + printed)


PARAMETERS = st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55]) | st.integers(0, 255),
                      max_size=40).map(bytes)


@settings(max_examples=100)
@given(st.lists(st.tuples(st.integers(0, 252), st.integers(0, 255), PARAMETERS), max_size=4),
       st.lists(st.integers(1, 30), min_size=1))
def test_packets_are_found_however_their_bytes_come(wanted, cuts):
    data, found, reader = b''.join(packet(*each) for each in wanted), [], PacketReader()
    while data:
        cuts.append(cuts.pop(0))
        found += reader.feed(data[:cuts[0]])
        data = data[cuts[0]:]
    assert [(p.id, p.instruction, p.parameters) for p in found if p.intact] == wanted


@settings(max_examples=100)
@given(st.binary(max_size=60), PARAMETERS, st.data())
def test_a_damaged_packet_is_never_taken_for_an_intact_one_and_the_next_is_understood(
        noise, parameters, data):
    whole = bytearray(packet(7, Instruction.WRITE, parameters))
    at = data.draw(st.integers(0, len(whole) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    reader = PacketReader()
    found = [p for p in reader.feed(noise.replace(b'\xff', b'') + bytes(whole)) if p.intact]
    reader.clear()  # as after a pause
    assert not found
    assert [p.id for p in reader.feed(packet(9, Instruction.PING))] == [9]


# The maker's SDK


def test_servos_are_found_by_ping_and_broadcast_ping(monkeypatch):
    monkeypatch.setattr(protocol2_packet_handler, 'MAX_ID', 20)  # or it waits for 252 servos
    with bus(3) as host:
        assert host.handler.ping(host.port, 2) == (1020, sdk.COMM_SUCCESS, 0)
        assert host.handler.ping(host.port, 9)[1] == LOST
        assert host.handler.broadcastPing(host.port) == (
            {n: [1020, 48] for n in (1, 2, 3)}, sdk.COMM_SUCCESS)


def test_many_servos_are_read_and_written_at_once():
    with bus(3) as host:
        ids = [1, 2, 3]
        reader = sdk.GroupSyncRead(host.port, host.handler, POSITION, 4)
        writer = sdk.GroupSyncWrite(host.port, host.handler, PROFILE_VELOCITY, 4)
        for n in ids:
            assert reader.addParam(n) and writer.addParam(n, [n, 1, 0, 0])
        assert writer.txPacket() == sdk.COMM_SUCCESS
        assert [host.read(n, PROFILE_VELOCITY) for n in ids] == [257, 258, 259]
        for read in reader.txRxPacket, reader.fastSyncRead:
            assert read() == sdk.COMM_SUCCESS
            assert [reader.getData(n, POSITION, 4) for n in ids] == [700, 1400, 2100]
        bulk = sdk.GroupBulkRead(host.port, host.handler)
        assert bulk.addParam(1, POSITION, 4) and bulk.addParam(3, 146, 1)
        for read in bulk.txRxPacket, bulk.fastBulkRead:
            assert read() == sdk.COMM_SUCCESS
            assert (bulk.getData(1, POSITION, 4), bulk.getData(3, 146, 1)) == (700, 30)
        bulk = sdk.GroupBulkWrite(host.port, host.handler)
        assert bulk.addParam(1, 65, 1, [1]) and bulk.addParam(2, PROFILE_VELOCITY, 4, [9, 0, 0, 0])
        assert bulk.txPacket() == sdk.COMM_SUCCESS
        assert (host.read(1, 65, 1), host.read(2, PROFILE_VELOCITY)) == (1, 9)


def test_what_is_missing_ends_a_sync_read_and_nothing_is_made_up():
    with bus(3) as host:
        host.emulator.servos[1].power_off()
        reader = sdk.GroupSyncRead(host.port, host.handler, POSITION, 4)
        for n in (1, 2, 3):
            reader.addParam(n)
        assert reader.txRxPacket() == LOST
        assert reader.fastSyncRead() != sdk.COMM_SUCCESS


def test_a_registered_write_waits_for_the_action():
    with bus() as host:
        assert host.handler.regWriteTxRx(host.port, 1, 65, 1, [1]) == (sdk.COMM_SUCCESS, 0)
        assert (host.read(1, 65, 1), host.read(1, 69, 1)) == (0, 1)
        host.handler.action(host.port, 1)
        host.emulator.clock.sleep(0.05)  # its answer, which the SDK leaves on the line
        assert (host.read(1, 65, 1), host.read(1, 69, 1)) == (1, 0)


def test_a_reboot_keeps_the_eeprom_and_forgets_the_ram_and_whole_turns():
    with bus() as host:
        assert host.write(2, TORQUE, 1, 1) == 0
        assert host.write(2, GOAL, 1400 + 5000) == 0
        until(host.emulator, lambda: host.read(2, POSITION) > 6300, step=0.01)
        assert host.write(2, WATCHDOG, 50, 1) == 0
        assert host.handler.clearMultiTurn(host.port, 2) == (sdk.COMM_SUCCESS, 1)  # it moves
        host.emulator.servos[1].motor.caught = True
        where = host.read(2, POSITION)
        assert host.handler.reboot(host.port, 2) == (sdk.COMM_SUCCESS, 0)
        assert host.handler.ping(host.port, 2)[1] == LOST
        host.emulator.clock.sleep(BOOT_TIME)
        assert host.read(2, POSITION) == pytest.approx(where % 4096, abs=1)
        assert [host.read(2, a, 1) for a in (MODE, TORQUE, WATCHDOG)] == [5, 0, 0]
        assert host.handler.factoryReset(host.port, 2, 2) == (sdk.COMM_SUCCESS, 0)
        host.emulator.clock.sleep(BOOT_TIME)
        assert host.read(2, MODE, 1) == 3


@pytest.mark.parametrize(('address', 'size', 'value', 'error'), [
    (MODE, 1, 4, 7),  # EEPROM is locked while the torque is on
    (POSITION, 4, 0, 7), (66, 1, 0, 7), (4000, 1, 0, 7),
    (GOAL, 2, 0, 5), (118, 2, 0, 5),
    (TORQUE, 1, 2, 4), (WATCHDOG, 1, -1, 4), (PROFILE_VELOCITY, 4, 32768, 4),
    (GOAL, 4, 4096, 6), (GOAL, 4, -1, 6), (GOAL_CURRENT, 2, 801, 6), (GOAL, 4, 4095, 0),
])
def test_a_write_that_is_not_allowed_changes_nothing_and_says_why(address, size, value, error):
    servo = DynamixelServo(MODELS['XM430-W350'])
    assert put(servo, 38, 800, 2) == 0 and put(servo, TORQUE, 1, 1) == 0
    before = dict(servo.values)
    assert put(servo, address, value, size) == error
    assert (servo.values == before) == (error != 0)


def test_modes_that_a_model_does_not_have_are_refused():
    servo = DynamixelServo(MODELS['XL430-W250'])
    assert put(servo, MODE, 5, 1) == 4 and put(servo, MODE, 4, 1) == 0
    assert put(servo, GOAL_CURRENT, 1, 2) == 7


def test_indirect_data_is_what_its_addresses_say():
    servo = DynamixelServo(MODELS['XL330-M288'])
    for i in range(4):
        assert put(servo, 168 + 2 * i, GOAL + i, 2) == 0
    assert put(servo, TORQUE, 1, 1) == 0
    assert put(servo, 208, 1234) == 0 and get(servo, GOAL) == get(servo, 208) == 1234
    assert put(servo, 208, 9999) == 6


@pytest.mark.parametrize(('level', 'answers'), [(0, [True, False, False]),
                                                (1, [True, True, False])])
def test_the_status_return_level_says_what_is_answered(level, answers):
    servo = DynamixelServo(MODELS['XM430-W350'])
    servo.values['Status Return Level'] = level
    asked = [(Instruction.PING, b''), (Instruction.READ, b'\0\0\2\0'),
             (Instruction.WRITE, b'\x41\0\1')]
    assert [servo.execute(*each) is not None for each in asked] == answers
    assert servo.values['LED'] == 1


# The wire


def test_a_wrong_baud_rate_gets_no_answer_and_changes_nothing():
    with bus(baud_rate=57600) as host:
        assert host.handler.ping(host.port, 1)[1] == LOST
        host.port.setBaudRate(1000000)
        assert host.handler.ping(host.port, 1)[1] == sdk.COMM_SUCCESS


def test_a_servo_with_protocol_1_answers_only_that():
    with bus(protocol=1) as host:
        assert host.handler.ping(host.port, 1)[1] == LOST
        host.port.closePort()
        old = Bus(host.emulator, protocol=1.0)
        assert old.handler.ping(old.port, 1)[1] == sdk.COMM_SUCCESS
        assert old.read(1, POSITION) == 700
        assert old.write(1, 65, 1, 1) == 0 and old.read(1, 65, 1) == 1
        host.port = old.port


def test_two_servos_with_one_id_answer_over_each_other():
    with bus() as host:
        host.emulator.collide(1, 0)
        results = {host.handler.readTxRx(host.port, 1, POSITION, 4)[1] for _ in range(5)}
        assert sdk.COMM_SUCCESS not in results


def test_a_damaged_instruction_is_answered_by_an_error_and_not_carried_out():
    with bus() as host:
        whole = bytearray(packet(1, Instruction.WRITE, b'\x41\0\1'))
        whole[-3] = 0
        host.port.writePort(bytes(whole))
        host.port.setPacketTimeout(11)
        answer, result = host.handler.rxPacket(host.port, False)
        assert result == sdk.COMM_SUCCESS and answer[8] == 3
        assert host.read(1, 65, 1) == 0


def test_bytes_take_their_time_on_the_wire():
    with bus() as host:
        put(host.emulator.servos[0], 8, 0, 1)
        host.port.setBaudRate(9600)
        clock = host.emulator.clock
        begin = clock()
        assert host.handler.readTxRx(host.port, 1, 0, 100)[1] == sdk.COMM_SUCCESS
        # 14 bytes there, 111 back, at 10 bits each, and the return delay.
        assert clock() - begin >= 125 * 10 / 9600 + 500e-6


# Motor and tendon


def test_a_trapezoidal_profile_takes_the_time_that_the_manual_says():
    servo = pulling(stiffness=0.0)
    velocity, acceleration, way = 100, 20, 6000
    assert put(servo, PROFILE_ACCELERATION, acceleration) == 0
    assert put(servo, PROFILE_VELOCITY, velocity) == 0
    assert put(servo, GOAL, 1000 + way) == 0
    assert get(servo, 123, 1) >> 4 == 3 and get(servo, 122, 1) == 1
    ramp = 64 * velocity / acceleration * 1e-3  # s
    wanted = way / (velocity * 0.229 * 4096 / 60) + ramp
    run(servo, wanted - 0.05)
    assert get(servo, 123, 1) & 2
    run(servo, 0.1)
    assert not get(servo, 123, 1) & 2
    run(servo, 0.5)
    assert get(servo, POSITION) == pytest.approx(1000 + way, abs=15)
    assert get(servo, 122, 1) == 0


def test_a_timed_profile_takes_the_time_that_it_is_given():
    servo = DynamixelServo(MODELS['XM430-W350'], tendon=SpringTendon(stiffness=0.0))
    for address, value, size in ((10, 4, 1), (MODE, 4, 1), (TORQUE, 1, 1),
                                 (PROFILE_VELOCITY, 1500, 4), (PROFILE_ACCELERATION, 300, 4)):
        assert put(servo, address, value, size) == 0
    assert put(servo, GOAL, 3000) == 0
    run(servo, 1.45)
    assert get(servo, 123, 1) & 2
    run(servo, 0.1)
    assert not get(servo, 123, 1) & 2


@pytest.mark.parametrize(('model', 'unit'), [('XL330-M288', 1e-3), ('XC330-T288', 1e-3),
                                             ('XM430-W350', 2.69e-3), ('XM540-W270', 2.69e-3)])
def test_the_goal_current_limits_the_tension(model, unit):
    """Stall torque and current of the data sheets give the torque of each A."""
    torque, ampere = {'XL330-M288': (0.52, 1.47), 'XC330-T288': (0.92, 0.80),
                      'XM430-W350': (4.1, 2.3), 'XM540-W270': (10.6, 4.4)}[model]
    servo = pulling(round(0.2 * ampere / unit), model, stiffness=20000.0)
    assert put(servo, PROFILE_VELOCITY, 40) == 0 and put(servo, GOAL, 9000) == 0
    run(servo, 5.0)
    assert servo.motor.speed == 0.0 and get(servo, POSITION) < 8000
    most = 0.2 * torque / 0.01  # N on a spool of 1 cm
    rubbing = 0.1 * most + 0.01 * torque / 0.01
    assert servo.motor.tension == pytest.approx(most, abs=rubbing)
    assert get(servo, 126, 2) * unit == pytest.approx(0.2 * ampere, abs=6 * unit)


@pytest.mark.parametrize('sign', [1, -1])
def test_present_current_tells_the_tension_to_the_friction_of_the_gears(sign):
    servo = pulling(600, weight=20.0, stiffness=0.0, sign=sign)
    run(servo, 1.0)
    held = sign * get(servo, 126, 2) * 2.69e-3 * 4.1 / 2.3 / 0.01
    assert held == pytest.approx(20.0, abs=1.2 * (0.1 * 20.0 + 0.01 * 4.1 / 0.01) + 2.0)


def test_without_torque_the_tendon_turns_the_spool_back():
    servo = pulling(weight=20.0, stiffness=0.0)
    run(servo, 0.5)
    before = servo.motor.pull
    assert put(servo, TORQUE, 0, 1) == 0
    run(servo, 0.2)
    assert servo.motor.pull < before - 0.001


def test_a_bus_that_is_silent_ends_the_motion_until_the_watchdog_is_cleared():
    servo = pulling(stiffness=0.0)
    assert put(servo, WATCHDOG, 5, 1) == 0 and put(servo, PROFILE_VELOCITY, 50) == 0
    assert put(servo, GOAL, 20000) == 0
    servo.heard = servo.time
    run(servo, 0.09)
    assert servo.motor.speed > 0.0 and get(servo, WATCHDOG, 1) == 5
    run(servo, 0.3)
    where = get(servo, POSITION)
    assert servo.motor.speed == 0.0 and get(servo, WATCHDOG, 1) == 255 and where < 2000
    assert put(servo, GOAL, 0) == 4 and put(servo, WATCHDOG, 5, 1) == 4
    assert put(servo, WATCHDOG, 0, 1) == 0
    run(servo, 0.3)
    assert get(servo, POSITION) == pytest.approx(where, abs=2)
    assert put(servo, GOAL, where + 500) == 0
    run(servo, 1.0)
    assert get(servo, POSITION) == pytest.approx(where + 500, abs=15)


def test_whole_turns_are_lost_with_the_power_and_parts_of_one_are_not():
    servo = pulling(stiffness=0.0)
    assert put(servo, GOAL, 1000 + 3 * 4096 + 500) == 0
    run(servo, 5.0)
    before = get(servo, POSITION)
    servo.power_off()
    servo.motor.angle += 100 * 2 * pi / 4096  # somebody turns it
    servo.power_on()
    assert get(servo, POSITION) == pytest.approx((before + 100) % 4096, abs=1)
    assert get(servo, TORQUE, 1) == 0


# Hardware errors


@pytest.mark.parametrize(('break_it', 'bit', 'limp'), [
    (lambda s: s.fail(32), 32, True), (lambda s: s.fail(16), 16, True),
    (lambda s: setattr(s, 'temperature', 90), 4, True),
    (lambda s: setattr(s, 'broken', 8), 8, False),  # not in the mask of an XM
    (lambda s: setattr(s, 'supply', 8.0), 1, False),
])
def test_a_hardware_error_is_told_and_switches_off_what_its_mask_says(break_it, bit, limp):
    servo = pulling()
    break_it(servo)
    run(servo, 0.1)
    if limp:
        servo.repair()  # it stays off all the same
    run(servo, 0.1)
    assert get(servo, ERRORS, 1) == bit and get(servo, TORQUE, 1) == (not limp)
    assert servo.execute(Instruction.PING, b'')[0] == 0x80
    if limp:
        assert put(servo, TORQUE, 1, 1) == 0x81 and get(servo, TORQUE, 1) == 0
        servo.execute(Instruction.REBOOT, b'')
        run(servo, BOOT_TIME + 0.1)
        assert get(servo, ERRORS, 1) == 0 and put(servo, TORQUE, 1, 1) == 0


def test_a_motor_that_stalls_with_all_it_has_is_overloaded():
    servo = pulling(stiffness=1e5)
    assert put(servo, GOAL, 9000) == 0
    run(servo, 2.0)
    assert get(servo, ERRORS, 1) == 32 and not servo.torque


# The command line


def test_faults_are_typed_and_the_state_is_printed():
    with bus() as host:
        emulator = host.emulator
        assert execute_command(emulator, 'overload 2') == 'done'
        assert 'hardware error 32' in execute_command(emulator, 'state').splitlines()[2]
        execute_command(emulator, 'collide 2 1')
        assert [servo.values['ID'] for servo in emulator.servos] == [1, 1]
        execute_command(emulator, 'repair')
        assert [servo.values['ID'] for servo in emulator.servos] == [1, 2]


def test_a_model_that_cannot_speak_protocol_1_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(['--model', 'XL330-M288', '--protocol-1'])
    assert 'does not support Protocol 1.0' in capsys.readouterr().err
