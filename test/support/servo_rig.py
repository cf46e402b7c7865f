# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A driver on emulated Dynamixel servos, faults, and what must hold whatever fails.

The emulator has the truth: by how much every tendon is pulled in, and whether a spool turns.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random

from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.dynamixel.setup import Spools
from soft_continuum.hardware.dynamixel.tendons import DynamixelTendons
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.sim.emulators.dynamixel import (
    DynamixelEmulator,
    make_servos,
    SERVO_MODEL,
    SPOOL_RADIUS,
    tension_limit,
)
from soft_continuum.sim.emulators.dynamixel_models import PULSE
from soft_continuum.sim.emulators.dynamixel_packets import Instruction
from support.virtual_clock import VirtualClock

TENDONS = 'first', 'second', 'third', 'fourth'
SIGNS = 1, -1, 1, -1
SPEED, ACCELERATION = 0.03, 0.3  # m/s, m/s^2
WITHIN_TURN, BEYOND_TURN = (-0.02, 0.02), (-0.06, 0.06)
"""pull_limits with which a power cycle leaves one turn that can be, and more than one."""
CYCLE = 0.02  # s between two set-points, as of the node
PULSE_PULL = SPOOL_RADIUS * PULSE  # m
TOLERANCE = 2.5 * PULSE_PULL
"""m by which a reported pull may differ: it is rounded, and so is the zero."""
AGE = 0.3  # s that a reading may be old
TIMEOUT = 20.0  # s of emulated time for anything to happen


class WrongStateError(AssertionError):
    """What the driver says is not so."""


@dataclass
class ServoRig:
    """Servos and the driver; zero: the true pulls at its zero, m."""

    emulator: DynamixelEmulator
    driver: DynamixelTendons
    zero: tuple[float, ...]
    seen: deque[tuple[float, tuple[float, ...]]]

    @property
    def pulls(self) -> tuple[float, ...]:
        """The true pulls, m."""
        return tuple(a - b for a, b in zip(self.emulator.pulls, self.zero, strict=True))

    def look(self) -> None:
        """Note the truth."""
        now = self.emulator.clock()
        self.seen.append((now, self.pulls))
        while self.seen[0][0] < now - AGE:
            self.seen.popleft()

    def check(self) -> bool:
        """Read; whether the position is known.  Raises WrongStateError if it is not the truth."""
        reading = self.driver.read()
        self.look()
        if not reading.referenced:
            return False
        for i, pull in enumerate(reading.pulls):
            was = [pulls[i] for _, pulls in self.seen]
            if not min(was) - TOLERANCE <= pull <= max(was) + TOLERANCE:
                raise WrongStateError(
                    f'{TENDONS[i]} is reported at {1e3 * pull:.3f} mm; it was between '
                    f'{1e3 * min(was):.3f} and {1e3 * max(was):.3f} mm')
        return True

    def wait(self, seconds: float) -> None:
        """Let time pass and watch."""
        clock = self.emulator.clock
        end = clock() + seconds
        while clock() < end:
            clock.sleep(CYCLE)
            self.look()

    def rest(self, step: float = 0.01) -> float:
        """Wait until no spool has turned for 0.1 s; return since when, to a step, in s."""
        clock = self.emulator.clock
        end, since = clock() + TIMEOUT, clock()
        while clock() - since < 0.1:
            clock.sleep(step)
            if self.emulator.moving:
                since = clock()
            if clock() > end:
                speeds = [servo.motor.speed for servo in self.emulator.servos]
                raise WrongStateError(f'the spools never rest: {speeds} rad/s')
        self.look()
        return since

    def follow(self, goal: tuple[float, ...], seconds: float,
               meanwhile: Callable[[], object] = lambda: None) -> None:
        """Send set-points to a goal, as the node does, until the tendons rest."""
        def look() -> None:
            meanwhile()
            self.check()

        go(self.driver, self.emulator.clock, goal, seconds, look)

    def reopen(self) -> None:
        """Connect anew, as the node does by itself."""
        self.driver.close()
        self.driver.open()
        self.look()


def go(driver: DynamixelTendons, clock: Clock, goal: tuple[float, ...], seconds: float,
       meanwhile: Callable[[], object]) -> None:
    """Send set-points to a goal, as the node does, until the tendons rest."""
    begin, start = driver.read().pulls, clock()
    while (part := (clock() - start) / seconds) < 1.0:
        driver.move(tuple(a + part * (b - a) for a, b in zip(begin, goal, strict=True)), CYCLE)
        clock.sleep(CYCLE)
        meanwhile()
    driver.move(goal, CYCLE)
    while driver.read().moving:
        clock.sleep(CYCLE)
        meanwhile()
        if clock() > start + seconds + TIMEOUT:
            raise WrongStateError('the motion never ends')


def spools(tendons: int = len(TENDONS), **changes: object) -> Spools:
    """Parameters of the driver for the emulated servos."""
    return Spools(**{  # type: ignore[arg-type]
        'tendons': TENDONS[:tendons], 'ids': tuple(n + 1 for n in range(tendons)),
        'radii': (SPOOL_RADIUS,) * tendons, 'signs': SIGNS[:tendons],
        'tension_limits': (60.0,) * tendons, 'torque_constants': (0.0,) * tendons,
        'speed_limit': SPEED, 'acceleration_limit': ACCELERATION, 'pull_limits': WITHIN_TURN,
        **changes})


def servos(tendons: int = len(TENDONS), model: str = SERVO_MODEL, link: Path | None = None,
           clock: VirtualClock | None = None) -> DynamixelEmulator:
    """Emulated servos with elastic tendons, without a driver."""
    made = make_servos(tendons, model, signs=SIGNS)
    for servo in made:
        servo.motor.tendon.stiffness = 500.0
        servo.motor.tendon.weight = 2.0
    return DynamixelEmulator(made, link, clock or VirtualClock())


def driver_of(emulator: DynamixelEmulator, folder: Path, **changes: object) -> DynamixelTendons:
    """Return a driver, not opened, of emulated servos; it keeps its zeros in a folder."""
    return DynamixelTendons(emulator.port, 1000000, spools(len(emulator.servos), **changes),
                            folder / 'zeros.json', emulator.clock)


def refusal(driver: DynamixelTendons) -> str:
    """Return why a driver does not open."""
    try:
        driver.open()
    except HardwareError as error:
        return str(error)
    raise AssertionError('it opens')


@contextmanager
def rig(folder: Path, limits: tuple[float, float] = WITHIN_TURN, tendons: int = len(TENDONS),
        model: str = SERVO_MODEL, **changes: object) -> Iterator[ServoRig]:
    """Servos and an open driver at zero pull."""
    with servos(tendons, model, folder / 'port') as emulator:
        driver = driver_of(emulator, folder, **{
            'pull_limits': limits, 'tension_limits': (tension_limit(model),) * tendons, **changes})
        driver.open()
        made = ServoRig(emulator, driver, emulator.pulls, deque())
        made.rest()
        driver.reference()
        made.zero = emulator.pulls
        made.wait(0.1)
        try:
            yield made
        finally:
            driver.close()


def in_motion(made: ServoRig, pull: float = 0.04) -> None:
    """Start a long motion of two tendons and let it get well under way."""
    made.driver.move((pull, -pull), 2.0)
    made.wait(0.3)
    assert made.emulator.moving


# Faults


@dataclass(frozen=True)
class Fault:
    """
    What fails.

    inject: does it.  fails: whether the driver has to notice; None: it may.  limp: whether a
    motor loses its torque.
    """

    name: str
    inject: Callable[[DynamixelEmulator, Random], object]
    fails: bool | None = True
    limp: bool = False


def _attribute(name: str, *values: float) -> Callable[[DynamixelEmulator, Random], None]:
    return lambda emulator, random: setattr(emulator, name, random.choice(values))


def _one(change: Callable[..., object]) -> Callable[[DynamixelEmulator, Random], None]:
    """Return a fault of a servo chosen at random."""
    def inject(emulator: DynamixelEmulator, random: Random) -> None:
        servo = random.choice(emulator.servos)
        emulator.read(lambda: change(servo))
    return inject


def _power_cycle_one(emulator: DynamixelEmulator, random: Random) -> None:
    emulator.power_cycle(random.randrange(len(emulator.servos)))


def _collide(emulator: DynamixelEmulator, random: Random) -> None:
    number, other = random.sample(range(len(emulator.servos)), 2)
    emulator.collide(number, other)


def _supply(volts: float) -> Callable[[DynamixelEmulator, Random], None]:
    def inject(emulator: DynamixelEmulator, _: Random) -> None:
        for servo in emulator.servos:
            servo.supply = volts
    return inject


FAULTS = (
    Fault('cable pulled', lambda emulator, _: emulator.unplug()),
    Fault('one servo power-cycled', _power_cycle_one, limp=True),
    Fault('all servos power-cycled', lambda emulator, _: emulator.power_cycle(), limp=True),
    Fault('one servo without power', _one(lambda s: s.power_off()), limp=True),
    Fault('one servo rebooted by another program',
          _one(lambda s: s.execute(Instruction.REBOOT, b'')), limp=True),
    Fault('one servo hangs', _one(lambda s: setattr(s, 'hang', True))),
    Fault('a few answers lost', _attribute('drop', 1, 2, 3), fails=False),
    Fault('all answers lost', _attribute('drop', 1000000)),
    Fault('one instruction lost', _attribute('deaf', 1), fails=False),
    Fault('all instructions lost', _attribute('deaf', 1000000)),
    Fault('answers late', _attribute('late', 0.005, 0.02, 0.05, 0.2), fails=None),
    Fault('answers damaged', _attribute('garble', 0.02, 0.2, 0.6), fails=None),
    Fault('instructions damaged', _attribute('garble_in', 0.02, 0.2, 0.6), fails=None),
    Fault('overload', _one(lambda s: s.fail(32)), limp=True),
    Fault('electrical shock', _one(lambda s: s.fail(16)), limp=True),
    Fault('overheating', _one(lambda s: setattr(s, 'temperature', 95)), limp=True),
    Fault('encoder broken', _one(lambda s: setattr(s, 'broken', 8))),
    Fault('supply too low', _supply(8.0)),
    Fault('supply too high', _supply(17.0)),
    Fault('two servos with one ID', _collide),
    Fault('watchdog expired', _one(lambda s: s.expire())),
    Fault('torque switched off by another program',
          _one(lambda s: s.write(64, b'\0')), limp=True),
    Fault('spool caught', _one(lambda s: setattr(s.motor, 'caught', True)), fails=None),
)


@dataclass(frozen=True)
class Outcome:
    """
    What a fault did.

    noticed: whether the driver failed, after s.  ran_on: m by which a tendon went on after the
    fault, and s for which.  known: whether the position is known after the repair.
    """

    noticed: bool
    noticed_after: float
    ran_on: float
    ran_for: float
    known: bool


def somewhere(random: Random, tendons: int) -> tuple[float, ...]:
    """Return pulls (m) within both limits."""
    return tuple(random.uniform(-0.018, 0.018) for _ in range(tendons))


def trial(folder: Path, fault: Fault, seed: int, moving: bool, tendons: int = len(TENDONS)
          ) -> Outcome:
    """Let something fail at a random time; raise WrongStateError for what must not be."""
    random = Random(f'{fault.name} {seed} {moving}')
    limits = random.choice([WITHIN_TURN, BEYOND_TURN])
    with rig(folder, limits, tendons) as made:
        emulator, clock = made.emulator, made.emulator.clock
        emulator.random.seed(f'{fault.name} {seed}')  # which packets are damaged
        made.follow(somewhere(random, tendons), 0.6)
        due = clock() + random.uniform(0.0, 0.6)
        at: list[tuple[float, tuple[float, ...]]] = []

        def inject() -> None:
            if not at and clock() >= due:
                at.append((clock(), made.pulls))
                fault.inject(emulator, random)

        noticed, ended = False, clock()
        try:
            if moving:
                made.follow(somewhere(random, tendons), 1.2, inject)
            while clock() < due + 1.0:
                inject()
                clock.sleep(CYCLE)
                made.check()
        except HardwareError:
            noticed, ended = True, clock()
        if fault.fails is not None and noticed != fault.fails:
            raise WrongStateError(f'{fault.name} was {"" if noticed else "not "}noticed')
        began, before = at[0]
        stood = made.rest()
        ran_on = max(abs(a - b) for a, b in zip(made.pulls, before, strict=True))
        return Outcome(noticed, ended - began, ran_on, max(0.0, stood - began),
                       recover(made, fault))


def repair(emulator: DynamixelEmulator) -> None:
    """End all faults: plug in, give power, reboot what has shut down."""
    emulator.repair()
    emulator.plug()
    for servo in emulator.servos:
        if not servo.powered:
            servo.power_on()
        if servo.values['Hardware Error Status'] & servo.values['Shutdown']:
            servo.execute(Instruction.REBOOT, b'')


def recover(made: ServoRig, fault: Fault) -> bool:
    """Repair as an operator does; return whether the position is known, and true, without him."""
    emulator = made.emulator
    repair(emulator)
    made.wait(0.5)
    made.rest()
    where = made.pulls
    made.reopen()
    made.rest()
    if not fault.limp and max(abs(a - b) for a, b in zip(
            made.pulls, where, strict=True)) > TOLERANCE:
        raise WrongStateError(f'connecting moved the tendons from {where} to {made.pulls}')
    made.seen.clear()
    known = made.check()
    if not known:
        made.driver.reference()
        made.zero = emulator.pulls
        made.wait(0.2)
        made.seen.clear()
        if not made.check():
            raise WrongStateError('it cannot be referenced')
    made.follow((0.0,) * len(emulator.servos), 0.7)  # and it works again
    return known
