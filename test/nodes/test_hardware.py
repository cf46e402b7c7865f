# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The four nodes on emulated GRBL and Modbus devices on real pseudo-terminals, under faults."""

from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
import itertools
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from soft_continuum.hardware.simulated_jamming import JammingPlant
from soft_continuum.nodes import managed_node, shape_sequencer
from soft_continuum.sim.emulators import modbus
from soft_continuum.sim.emulators.grbl import GrblEmulator
from soft_continuum.sim.emulators.modbus import ModbusEmulator
from soft_continuum_interfaces.action import RunShapeSequence
from support.ros_rig import assert_declined, LATCHED, Rig

Result = RunShapeSequence.Result
STEP = 5e-6  # m: 200 steps per mm
BEND = (0.0, 0.0, 0.3)
BEND_MORE = (0.0, 0.0, -0.3)


@dataclass
class Bench:
    """The nodes, and the devices that they drive."""

    rig: Rig
    grbl: GrblEmulator
    modbus: ModbusEmulator
    ports: Path
    zero: tuple[int, ...] = (0, 0)
    """Steps of the motors where the arm was said to be straight."""

    def parameters(self):
        return {
            'tendon_driver': 'grbl', 'grbl.port': str(self.ports / 'grbl'),
            'jamming_driver': 'modbus', 'modbus.port': str(self.ports / 'modbus'),
            'tendon_speed': 0.01, 'tendon_acceleration': 0.1, 'speed_limit': 0.03,
            'acceleration_limit': 0.3, 'jamming_rate': 20.0, 'stale_timeout': 8.0,
            'modbus.timeout': 1.0,  # the emulator waits for a busy machine too
        }

    def prepare(self):
        """Make the arm stiff, and say that it is straight, twice where it was bent."""
        self.rig.stiffen()
        for service in ('resume', 'reference'):
            self.rig.wait_for(
                lambda s=service: self.rig.trigger(f'tendon_actuation/{s}').success, service)
        self.rig.wait_for(lambda: self.rig.trigger('kinematics/reset').success, 'a straight arm')
        self.rig.wait_for_shape()
        self.zero = self.grbl.motors

    def assert_steps_agree(self):
        """Claim that the motors have made the steps that the node reports as pulls."""
        self.rig.assert_rests()
        for pull, steps, zero in zip(self.rig.pulls, self.grbl.motors, self.zero, strict=False):
            assert pull == pytest.approx((steps - zero) * STEP, abs=1e-9)


@pytest.fixture(scope='module', autouse=True)
def quick():
    """Let the boards evacuate and vent a segment within a fifth of a second, no goal wait long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(modbus, 'JammingPlant', partial(
            JammingPlant, evacuation_time=0.05, venting_time=0.05, valve_delay=0.0))
        patch.setattr(shape_sequencer, 'FIRST_MESSAGE_TIMEOUT', 0.5)
        yield


@contextmanager
def bench_of(rig, ports, **board):
    """Switch both devices on; nodes end before their devices do."""
    with (GrblEmulator(str(ports / 'grbl'), **board) as grbl,
          ModbusEmulator(link=ports / 'modbus') as modbus):
        yield Bench(rig, grbl, modbus, ports)
        rig.end_all()


@pytest.fixture
def devices(rig, tmp_path):
    """Return the devices with no node started yet."""
    with bench_of(rig, tmp_path) as bench:
        yield bench


@pytest.fixture(scope='module')
def shared_bench(module_rig, tmp_path_factory):
    """Return the four nodes on their devices, for one test after the other."""
    with bench_of(module_rig, tmp_path_factory.mktemp('ports')) as bench:
        module_rig.start_arm(**bench.parameters())
        yield bench


@pytest.fixture
def bench(shared_bench):
    """Return the four nodes on their devices, stiff, straight and referenced."""
    shared_bench.prepare()
    return shared_bench


def error_in_diagnostics(rig, node):
    """Return what /diagnostics says of a node, once that is an error."""
    heard = rig.record(DiagnosticArray, '/diagnostics', QoSProfile(depth=50))

    def error():
        return next((s.message for m in list(heard) for s in m.status
                     if s.name.endswith(node) and s.level == DiagnosticStatus.ERROR), '')
    return str(rig.wait_for(error, f'an error of {node} in /diagnostics'))


def wait_for_error(rig, node, text):
    rig.wait_for(lambda: any(
        m.level == DiagnosticStatus.ERROR and text in m.message for m in rig.statuses[node]),
        f'an error of {node} with {text}')


def test_shapes_are_set_and_after_a_stop_the_motors_have_made_the_steps_reported(bench):
    rig = bench.rig
    goal = rig.goal_in_motion(BEND)
    assert rig.trigger('tendon_actuation/stop').success
    goal.assert_ended('ABORTED', code=Result.STOPPED)
    rig.wait_for(lambda: rig.at_rest, 'rest')
    bench.assert_steps_agree()
    assert rig.trigger('tendon_actuation/resume').success
    goal = rig.goal_when_heard(BEND, BEND_MORE)
    goal.assert_ended('SUCCEEDED')
    rig.assert_stiff_since(goal)
    bench.assert_steps_agree()
    assert abs(rig.pulls[0]) > 1e-3
    rig.assert_stiff_only_by_pressure()


def test_a_board_unplugged_in_motion_ends_the_goal_and_moves_only_after_resume(bench):
    rig = bench.rig
    goal = rig.goal_in_motion(BEND)
    bench.grbl.unplug()
    goal.assert_ended('ABORTED', 'the device failed')
    assert error_in_diagnostics(rig, 'tendon_actuation')
    bench.grbl.plug()
    rig.wait_for_status('tendon_actuation', 'stopped', 'the device failed')
    rig.wait_for(lambda: rig.statuses['tendon_actuation'].last.level == DiagnosticStatus.WARN,
                 'a reconnection')
    rests_at = bench.grbl.motors
    rig.assert_rests()
    assert bench.grbl.motors == rests_at
    rig.goal(BEND).assert_rejected('the device failed')
    assert rig.trigger('tendon_actuation/resume').success


@pytest.mark.parametrize('moving', [True, False])
def test_after_a_reset_of_the_board_nothing_moves_until_the_arm_is_said_to_be_straight(
        bench, moving):
    rig, status = bench.rig, bench.rig.statuses['kinematics']
    goal = rig.goal_in_motion(BEND) if moving else rig.goal_when_heard(BEND)
    rig.wait_for(lambda: abs(rig.pulls[0]) > 2e-3 if moving else goal.ended, 'a bend')
    rig.clear()
    board = bench.grbl
    # On a busy machine it rests now and then, until the next piece of the motion comes.
    rig.wait_for(lambda: board.read(lambda: board.moving is moving and (board.reset(), True)),
                 'a board that moves' if moving else 'a board at rest')
    assert goal.result()[0] == ('ABORTED' if moving else 'SUCCEEDED')
    if moving:
        rig.wait_for_status('tendon_actuation', 'stopped', 'the controller was reset')
    else:
        rig.wait_for(lambda: not rig.states['tendon_actuation'].last.referenced, 'a reset')
        rig.wait_for(lambda: rig.at_rest, 'rest')  # until it is sure, the driver reports motion
    rig.assert_rests()  # jogs that were under way reach the board after its reset
    rests_at = bench.grbl.motors
    rig.wait_for(lambda: not rig.states['tendon_actuation'].last.referenced, 'a lost position')
    rig.wait_for(lambda: 'not referenced' in status.last.message, 'a lost shape')
    shapes, said = len(rig.joints), len(status)
    rig.wait_for(lambda: rig.trigger('tendon_actuation/resume').success, 'a resume')
    rig.wait_for(lambda: not rig.status_value('tendon_actuation', 'stopped'), 'no stop')
    rig.goal(BEND).assert_rejected('not referenced')
    for soft in (3, 2, 1):  # of soft segments the pulls alone make the shape, and they read as 0
        rig.soften(soft)
        rig.assert_rests()
    assert bench.grbl.motors == rests_at
    assert not rig.trigger('kinematics/reset').success
    assert {s.level for s in list(status)[said:]} <= {DiagnosticStatus.WARN}
    assert len(rig.joints) == shapes
    assert not any(message.position for message in rig.wait_for_more(rig.tendons))

    rig.stiffen()
    for service in ('tendon_actuation/reference', 'kinematics/reset'):
        assert_declined(rig.trigger(service), 'segment 3 was bent by 0.')
        if 'reference' in service:
            assert rig.trigger(service).success
            rig.wait_for(lambda: 'segment 3 was bent' in status.last.message, 'an unknown shape')
            assert len(rig.joints) == shapes
    assert rig.trigger('kinematics/reset').success
    rig.wait_for(lambda: len(rig.joints) > shapes, 'a shape')
    assert not any(rig.joints.last.position)
    rig.goal_when_heard(BEND).assert_ended('SUCCEEDED')


def test_valves_unplugged_in_motion_end_the_goal_and_switch_nothing_when_back(bench):
    rig = bench.rig

    def set_timeouts(stale, jamming):
        for name, value in (('stale', stale), ('jamming', jamming)):
            assert rig.set_parameter('shape_sequencer', f'{name}_timeout', value).successful

    set_timeouts(2.0, 2.0)  # In vain it is tried to stiffen the arm.
    goal = rig.goal_in_motion(BEND)
    coils = bench.modbus.coils
    bench.modbus.unplug()
    goal.assert_ended('ABORTED', 'jamming_valves')
    assert error_in_diagnostics(rig, 'jamming_valves')
    rig.wait_for(lambda: rig.at_rest, 'rest')
    rig.wait_for(lambda: not any(flag.last.data for flag in rig.stiff), 'no stiffness known')
    bench.modbus.plug()
    rig.wait_for(lambda: rig.statuses['jamming_valves'].last.level == DiagnosticStatus.OK,
                 'the valves back')
    assert bench.modbus.coils == coils
    set_timeouts(8.0, 10.0)


def test_a_reply_that_is_lost_now_and_then_ends_no_goal(bench):
    goal = bench.rig.goal_in_motion(BEND, hold=0.0)
    replies = itertools.count()
    # The next one, and then one in fifty: never two in a row, which is more than now and then.
    bench.modbus.transform = lambda reply: reply if next(replies) % 50 else b''
    goal.assert_ended('SUCCEEDED')
    bench.modbus.transform = lambda reply: reply


def test_a_valve_that_does_not_follow_and_a_broken_wire_are_named(bench):
    rig = bench.rig
    bench.modbus.stuck = {3}
    assert_declined(rig.call(SetBool, 'jamming_valves/segment_3/set_stiff', data=False),
                    'coil 3 (valve of segment 3)')
    bench.modbus.stuck = set()
    rig.soften(3)
    bench.modbus.segments[1].broken_wire = True
    rig.wait_for(lambda: rig.soft_segments() == [2, 3], 'segment 2 no longer stiff')
    assert 'segment 2' in error_in_diagnostics(rig, 'jamming_valves')
    bench.modbus.segments[1].broken_wire = False


def test_settings_that_contradict_are_named_and_mended_without_a_restart(devices):
    devices.grbl.firmware.settings[1] = 25.0
    rig = devices.rig
    parameters = devices.parameters()
    rig.start('tendon_actuation', ready=False, **parameters)
    wait_for_error(rig, 'tendon_actuation', '$1=255')
    assert rig.lifecycle_state('tendon_actuation') == 'unconfigured'
    devices.grbl.firmware.settings[1] = 255.0
    rig.wait_for(lambda: len(rig.tendons), 'tendon_states')


def test_boards_plugged_in_later_are_found_and_nothing_moves(devices):
    rig, late = devices.rig, {'tendon_actuation': 'grbl', 'jamming_valves': 'modbus'}
    devices.grbl.unplug()
    devices.modbus.unplug()
    rig.start(*late, 'kinematics', ready=False, **devices.parameters())
    for node, board in late.items():
        wait_for_error(rig, node, str(devices.ports / board))
        assert rig.lifecycle_state(node) == 'unconfigured'
    devices.grbl.plug()
    devices.modbus.plug()
    rig.wait_until_ready(*late)
    rig.wait_for(lambda: rig.statuses['tendon_actuation'].last.message
                 == 'position not referenced: no zero since the controller was started or reset',
                 'no reference')
    rig.wait_for(lambda: 'not referenced' in rig.statuses['kinematics'].last.message, 'no shape')
    rig.assert_rests()
    assert not rig.joints
    assert devices.grbl.motors[:2] == (0, 0)
    assert not any(devices.modbus.coils)


def test_without_autostart_no_device_is_looked_for(devices):
    devices.grbl.unplug()
    rig = devices.rig
    rig.start('tendon_actuation', ready=False, autostart=False, **devices.parameters())
    assert not rig.transition('tendon_actuation', 'configure')
    devices.grbl.plug()
    time.sleep(2.5 * managed_node.RETRY)
    assert rig.lifecycle_state('tendon_actuation') == 'unconfigured'


def test_a_node_that_starts_during_an_emergency_stop_does_not_move(rig):
    switch, *others = [rig.observer.create_publisher(Bool, 'emergency_stop', LATCHED)
                       for _ in range(3)]
    switch.publish(Bool(data=True))
    for other in others:  # that are not stopping it
        other.publish(Bool(data=False))
    rig.start_arm()
    rig.wait_for_status('tendon_actuation', 'stopped', 'emergency_stop')
    switch.publish(Bool(data=False))  # of several nobody knows whose a message is
    rig.on_ros_thread(rig.observer.destroy_publisher, others.pop())
    assert not rig.trigger('tendon_actuation/resume').success
    rig.on_ros_thread(rig.observer.destroy_publisher, others.pop())

    def resumed():
        switch.publish(Bool(data=False))
        return bool(rig.trigger('tendon_actuation/resume').success)
    rig.wait_for(resumed, 'a resume')


@pytest.fixture
def homing(rig, tmp_path, request):
    """Return the nodes on a board with limit switches (steps), the arm straight and not stiff."""
    settings = {22: 1, 23: 3, 130: 20000, 131: 20000}
    with bench_of(rig, tmp_path, settings=settings, switches=request.param) as bench:
        # Switches at -7 and -6 mm of a straight arm, and 1 mm off them
        rig.start_arm(**bench.parameters(), **{'grbl.homed_pulls': [-0.006, -0.005]})
        yield bench


def home(rig):
    """Stiffen the arm and begin to home, once the servo has heard of the former."""
    assert rig.call(SetBool, 'jamming_valves/set_all_stiff', data=True).success
    rig.wait_for(lambda: rig.trigger('tendon_actuation/reference').success, 'a stiff arm')


@pytest.mark.parametrize('homing', [(-1400, -1200)], indirect=True, ids=['near'])
def test_homing_waits_for_a_stiff_arm_and_ends_with_a_known_straight_one(homing):
    rig = homing.rig
    assert_declined(rig.trigger('tendon_actuation/reference'), 'stiffen')
    home(rig)
    statuses = rig.statuses['tendon_actuation']
    rig.wait_for(lambda: any(s.message == 'homing' for s in statuses), 'a motion')
    rig.wait_for(lambda: statuses.last.message == 'holding', 'its end')
    assert homing.grbl.motors[:2] == (0, 0)
    rig.wait_for_shape()
    rig.goal_when_heard(BEND).assert_ended('SUCCEEDED')
    homing.assert_steps_agree()


@pytest.mark.parametrize('homing', [(-100_000, -100_000)], indirect=True, ids=['far'])
def test_homing_ends_when_the_arm_becomes_soft_or_it_is_stopped(homing):
    rig = homing.rig
    for end in (lambda: rig.set_stiff(2, False), lambda: rig.trigger('tendon_actuation/stop')):
        before = homing.grbl.motors
        home(rig)
        rig.wait_for(lambda: homing.grbl.moving, 'a motion')
        assert end().success
        rig.wait_for(lambda: not homing.grbl.moving and not any(rig.tendons.last.velocity), 'rest')
        where = homing.grbl.motors
        rig.assert_rests()
        assert homing.grbl.motors == where
        assert where[0] < before[0]
        rig.wait_for(lambda: rig.trigger('tendon_actuation/resume').success, 'a resume')
    reason = rig.rejection(rig.goal(BEND))
    assert 'not referenced' in reason or 'tendon_states' in reason
