# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The four nodes on emulated GRBL and Modbus devices on real pseudo-terminals, under faults."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
import itertools
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from soft_continuum.emulators import modbus_rig
from soft_continuum.emulators.grbl_board import GrblEmulator
from soft_continuum.emulators.modbus_rig import ModbusEmulator
from soft_continuum.hardware.simulated_jamming import JammingPlant
from soft_continuum.nodes import managed_node
from soft_continuum_interfaces.action import RunShapeSequence
from support.ros_rig import LATCHED, RELIABLE, Rig, STREAM

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

    def parameters(self) -> dict[str, Any]:
        return {
            'tendon_driver': 'grbl', 'grbl.port': str(self.ports / 'grbl'),
            'jamming_driver': 'modbus', 'modbus.port': str(self.ports / 'modbus'),
            'tendon_speed': 0.01, 'tendon_acceleration': 0.1, 'speed_limit': 0.03,
            'acceleration_limit': 0.3, 'jamming_rate': 20.0, 'stale_timeout': 8.0,
            'modbus.timeout': 1.0,  # the emulator waits for a busy machine too
        }

    def start(self, **changes: Any) -> None:
        self.rig.start_arm(**{**self.parameters(), **changes})

    def prepare(self) -> None:
        """Say that the arm is straight, and make it stiff."""
        self.rig.stiffen()
        assert self.rig.trigger('tendon_actuation/reference').success
        self.rig.wait_for_shape()

    def assert_steps_agree(self) -> None:
        """Claim that the motors have made the steps that the node reports as pulls."""
        self.rig.assert_rests()
        for pull, steps in zip(self.rig.pulls, self.grbl.motors, strict=False):
            assert pull == pytest.approx(steps * STEP, abs=1e-9)


@pytest.fixture(autouse=True)
def quick_air(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the boards evacuate and vent a segment within a fifth of a second."""
    monkeypatch.setattr(modbus_rig, 'JammingPlant', partial(
        JammingPlant, evacuation_time=0.05, venting_time=0.05, valve_delay=0.0))


@pytest.fixture
def boards(tmp_path: Path) -> Iterator[tuple[GrblEmulator, ModbusEmulator]]:
    """Return both devices, switched on."""
    with (GrblEmulator(str(tmp_path / 'grbl')) as grbl,
          ModbusEmulator(link=tmp_path / 'modbus') as modbus):
        yield grbl, modbus


@pytest.fixture
def devices(boards: tuple[GrblEmulator, ModbusEmulator], rig: Rig, tmp_path: Path) -> Bench:
    """Return the devices with no node started yet; nodes end before their devices do."""
    return Bench(rig, *boards, tmp_path)


@pytest.fixture
def bench(devices: Bench) -> Bench:
    """Return the four nodes on their devices, stiff, straight and referenced."""
    devices.start()
    devices.prepare()
    return devices


def error_in_diagnostics(rig: Rig, node: str) -> str:
    """Return what /diagnostics says of a node, once that is an error."""
    heard = rig.record(DiagnosticArray, '/diagnostics', QoSProfile(depth=50))

    def error() -> str:
        return next((s.message for m in list(heard) for s in m.status
                     if s.name.endswith(node) and s.level == DiagnosticStatus.ERROR), '')
    return str(rig.wait_for(error, f'an error of {node} in /diagnostics'))


def wait_for_error(rig: Rig, node: str, text: str) -> None:
    rig.wait_for(lambda: any(
        m.level == DiagnosticStatus.ERROR and text in m.message for m in rig.statuses[node]),
        f'an error of {node} with {text}')


def test_a_shape_is_set_and_the_motors_have_made_the_steps_reported(bench: Bench) -> None:
    goal = bench.rig.goal_when_heard(BEND, BEND_MORE)
    assert goal.result()[0] == 'SUCCEEDED'
    bench.rig.assert_stiff_since(goal)
    bench.assert_steps_agree()
    assert abs(bench.rig.pulls[0]) > 1e-3
    bench.rig.assert_stiff_only_by_pressure()


def test_nothing_moves_before_somebody_says_that_the_arm_is_straight(devices: Bench) -> None:
    devices.start()
    devices.rig.wait_for(lambda: devices.rig.statuses[
        'tendon_actuation'].last.message == 'position not referenced', 'no reference')
    devices.rig.call(SetBool, 'jamming_valves/set_all_stiff', data=True)
    devices.rig.wait_for(lambda: devices.rig.all_stiff, 'a stiff arm')
    devices.rig.goal(BEND).assert_rejected('not referenced')
    assert not devices.rig.joints  # nor does anybody know the shape
    assert devices.rig.all_stiff
    assert devices.grbl.motors[:2] == (0, 0)


def test_a_board_unplugged_in_motion_ends_the_goal_and_moves_only_after_resume(
        bench: Bench) -> None:
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


def test_a_reset_of_the_board_in_motion_loses_the_reference(bench: Bench) -> None:
    goal = bench.rig.goal_in_motion(BEND)
    bench.grbl.reset()
    rig = bench.rig
    assert goal.result()[0] == 'ABORTED'
    rig.wait_for_status('tendon_actuation', 'stopped', 'the controller was reset')
    rig.assert_rests()  # jogs that were under way reach the board after its reset
    rests_at = bench.grbl.motors
    rig.wait_for(lambda: rig.trigger('tendon_actuation/resume').success, 'a resume')
    rig.wait_for(lambda: not rig.status_value('tendon_actuation', 'stopped'), 'no stop')
    rig.goal(BEND).assert_rejected('not referenced')
    assert bench.grbl.motors == rests_at


def test_no_shape_is_valid_from_the_reset_of_a_board_on_until_the_arm_is_said_to_be_straight(
        bench: Bench) -> None:
    rig, status = bench.rig, bench.rig.statuses['kinematics']
    assert rig.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'
    bench.grbl.reset()
    rig.wait_for(lambda: not rig.states['tendon_actuation'].last.referenced, 'a lost position')
    rig.wait_for(lambda: 'not referenced' in status.last.message, 'a lost shape')
    shapes, said = len(rig.joints), len(status)
    for soft in (3, 2, 1):  # of soft segments the pulls alone make the shape, and they read as 0
        rig.soften(soft)
        rig.assert_rests()
    assert not rig.trigger('kinematics/reset').success
    assert {s.level for s in list(status)[said:]} <= {DiagnosticStatus.WARN}
    assert len(rig.joints) == shapes
    assert not any(message.position for message in rig.wait_for_more(rig.tendons))

    rig.stiffen()
    for service in ('tendon_actuation/reference', 'kinematics/reset'):
        asked = rig.trigger(service)
        assert not asked.success
        assert 'segment 3 was bent by 0.' in asked.message
        if 'reference' in service:
            assert rig.trigger(service).success
            rig.wait_for(lambda: 'segment 3 was bent' in status.last.message, 'an unknown shape')
            assert len(rig.joints) == shapes
    assert rig.trigger('kinematics/reset').success
    rig.wait_for(lambda: len(rig.joints) > shapes, 'a shape')
    assert not any(rig.joints.last.position)
    assert rig.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'


def test_a_stop_in_motion_rests_at_the_reported_step_and_resume_goes_on(bench: Bench) -> None:
    rig = bench.rig
    goal = rig.goal_in_motion(BEND)
    assert rig.trigger('tendon_actuation/stop').success
    assert goal.result()[1].error_code == Result.STOPPED
    rig.wait_for(lambda: rig.at_rest, 'rest')
    bench.assert_steps_agree()
    assert rig.trigger('tendon_actuation/resume').success
    assert rig.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'
    bench.assert_steps_agree()


def test_valves_unplugged_in_motion_end_the_goal_and_switch_nothing_when_back(
        devices: Bench) -> None:
    bench, rig = devices, devices.rig
    # In vain it is tried to stiffen the arm.
    bench.start(stale_timeout=2.0, jamming_timeout=2.0)
    bench.prepare()
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


def test_a_reply_that_is_lost_now_and_then_ends_no_goal(bench: Bench) -> None:
    goal = bench.rig.goal_in_motion(BEND, hold=0.0)
    replies = itertools.count()
    # The next one, and then one in fifty: never two in a row, which is more than now and then.
    bench.modbus.transform = lambda reply: reply if next(replies) % 50 else b''
    goal.assert_ended('SUCCEEDED')


def test_a_valve_that_does_not_follow_is_named(bench: Bench) -> None:
    bench.modbus.stuck = {3}
    answer = bench.rig.call(SetBool, 'jamming_valves/segment_3/set_stiff', data=False)
    assert not answer.success
    assert 'coil 3 (valve of segment 3)' in answer.message
    bench.modbus.stuck = set()
    bench.rig.soften(3)


def test_a_broken_sensor_wire_is_not_a_stiff_segment(bench: Bench) -> None:
    bench.modbus.segments[1].broken_wire = True
    bench.rig.wait_for(lambda: bench.rig.soft_segments() == [2], 'segment 2 no longer stiff')
    assert 'segment 2' in error_in_diagnostics(bench.rig, 'jamming_valves')


def test_settings_that_contradict_are_named_and_mended_without_a_restart(devices: Bench) -> None:
    devices.grbl.firmware.settings[1] = 25.0
    rig = devices.rig
    parameters = devices.parameters()
    rig.start('tendon_actuation', ready=False, **parameters)
    wait_for_error(rig, 'tendon_actuation', '$1=255')
    assert rig.lifecycle_state('tendon_actuation') == 'unconfigured'
    devices.grbl.firmware.settings[1] = 255.0
    rig.wait_for(lambda: len(rig.tendons), 'tendon_states')


def test_a_port_that_is_not_there_is_named_and_the_node_waits(rig: Rig) -> None:
    rig.start('tendon_actuation', ready=False,
              **{'tendon_driver': 'grbl', 'grbl.port': '/dev/no_such_port'})
    wait_for_error(rig, 'tendon_actuation', '/dev/no_such_port')
    assert rig.lifecycle_state('tendon_actuation') == 'unconfigured'


@pytest.mark.parametrize('board', ['grbl', 'modbus'])
def test_a_board_plugged_in_later_is_found_and_nothing_moves(devices: Bench, board: str) -> None:
    getattr(devices, board).unplug()
    devices.rig.start('tendon_actuation', 'jamming_valves', ready=False, **devices.parameters())
    late = {'grbl': 'tendon_actuation', 'modbus': 'jamming_valves'}[board]
    wait_for_error(devices.rig, late, str(devices.ports / board))
    assert devices.rig.lifecycle_state(late) == 'unconfigured'
    getattr(devices, board).plug()
    devices.rig.wait_until_ready('tendon_actuation', 'jamming_valves')
    devices.rig.assert_rests()
    assert devices.grbl.motors[:2] == (0, 0)
    assert not any(devices.modbus.coils)


def test_without_autostart_no_device_is_looked_for(devices: Bench) -> None:
    devices.grbl.unplug()
    rig = devices.rig
    rig.start('tendon_actuation', ready=False, autostart=False, **devices.parameters())
    assert not rig.transition('tendon_actuation', 'configure')
    devices.grbl.plug()
    time.sleep(2.5 * managed_node.RETRY)
    assert rig.lifecycle_state('tendon_actuation') == 'unconfigured'


@pytest.mark.parametrize('profile', [LATCHED, RELIABLE, STREAM],
                         ids=['latched', 'reliable', 'best effort'])
def test_an_emergency_stop_ends_the_motion_until_it_is_off_and_resumed(
        arm: Rig, profile: QoSProfile) -> None:
    button = arm.publisher(Bool, 'emergency_stop', profile)
    arm.wait_for(lambda: button.get_subscription_count() >= 2, 'all nodes to listen')
    goal = arm.goal((0.0, 0.0, 0.6), hold=60.0)
    arm.wait_for(lambda: arm.moving, 'a motion')
    button.publish(Bool(data=True))
    goal.assert_ended('ABORTED', 'emergency_stop', code=Result.STOPPED)
    arm.come_to_rest()
    soft = arm.soft_segments()
    assert not arm.trigger('tendon_actuation/resume').success
    refused = arm.call(SetBool, 'jamming_valves/set_all_stiff', data=True)
    assert 'emergency_stop' in refused.message
    assert not arm.goal(BEND).accepted
    button.publish(Bool(data=False))
    arm.wait_for(lambda: arm.trigger('tendon_actuation/resume').success, 'a resume')
    arm.assert_rests()
    assert arm.soft_segments() == soft
    arm.wait_for(lambda: arm.call(
        SetBool, 'jamming_valves/set_all_stiff', data=True).success, 'valves that obey')
    arm.wait_for(lambda: arm.all_stiff, 'a stiff arm')
    assert arm.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'


def test_a_node_that_starts_during_an_emergency_stop_does_not_move(rig: Rig) -> None:
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

    def resumed() -> bool:
        switch.publish(Bool(data=False))
        return bool(rig.trigger('tendon_actuation/resume').success)
    rig.wait_for(resumed, 'a resume')


HOMED = [-0.006, -0.005]  # m: switches at -7 and -6 mm of a straight arm, and 1 mm off them


@pytest.fixture
def switches() -> tuple[float, float]:
    """Return where the switches are, steps."""
    return -1400, -1200


@pytest.fixture
def homing(rig: Rig, tmp_path: Path, switches: tuple[float, float]) -> Iterator[Bench]:
    """Return the nodes on a stepper board with limit switches, the arm straight and stiff."""
    settings = {22: 1, 23: 3, 130: 20000, 131: 20000}
    with (GrblEmulator(str(tmp_path / 'grbl'), settings=settings, switches=switches) as grbl,
          ModbusEmulator(link=tmp_path / 'modbus') as modbus):
        bench = Bench(rig, grbl, modbus, tmp_path)
        bench.start(**{'grbl.homed_pulls': HOMED})
        yield bench


def home(rig: Rig) -> None:
    """Stiffen the arm and begin to home, once the servo has heard of the former."""
    assert rig.call(SetBool, 'jamming_valves/set_all_stiff', data=True).success
    rig.wait_for(lambda: rig.trigger('tendon_actuation/reference').success, 'a stiff arm')


def test_homing_waits_for_a_stiff_arm_and_ends_with_a_known_straight_one(homing: Bench) -> None:
    rig = homing.rig
    refused = rig.trigger('tendon_actuation/reference')
    assert not refused.success
    assert 'stiffen' in refused.message
    home(rig)
    statuses = rig.statuses['tendon_actuation']
    rig.wait_for(lambda: any(s.message == 'homing' for s in statuses), 'a motion')
    rig.wait_for(lambda: statuses.last.message == 'holding', 'its end')
    assert homing.grbl.motors[:2] == (0, 0)
    rig.wait_for_shape()
    assert rig.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'
    homing.assert_steps_agree()


@pytest.mark.parametrize('switches', [(-100_000, -100_000)], ids=['far'])  # to be met on the way
@pytest.mark.parametrize('how', ['stop', 'soften'])
def test_homing_ends_when_it_is_stopped_or_the_arm_becomes_soft(homing: Bench, how: str) -> None:
    rig = homing.rig
    home(rig)
    rig.wait_for(lambda: homing.grbl.moving, 'a motion')
    if how == 'stop':
        assert rig.trigger('tendon_actuation/stop').success
    else:
        rig.set_stiff(2, False)
    rig.wait_for(lambda: not homing.grbl.moving and not any(rig.tendons.last.velocity), 'rest')
    where = homing.grbl.motors
    rig.assert_rests()
    assert homing.grbl.motors == where
    assert where[0] < 0
    rig.wait_for(lambda: rig.trigger('tendon_actuation/resume').success, 'a resume')
    reason = rig.rejection(rig.goal(BEND))
    assert 'not referenced' in reason or 'tendon_states' in reason
