# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The protocols of drivers: tendon motors, and jamming valves or regulators."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Protocol, runtime_checkable, Self

ROUNDING = 1e-9  # m by which a pull may be beyond a limit
MAX_AHEAD = 5e-4
"""Tolerance (m) for a tendon that returns from beyond a limit."""


class HardwareError(RuntimeError):
    """A device failed; the message names the device, the observation and the remedy."""


def describe_pulls(tendons: Sequence[str], pulls: Sequence[float]) -> str:
    """Return pulls (m) for a person to read: ``right_tendon 12.30 mm, left_tendon -4.00 mm``."""
    return ', '.join(f'{name} {1e3 * pull:.2f} mm'
                     for name, pull in zip(tendons, pulls, strict=True))


def check_motion(tendons: Sequence[str], pulls: Sequence[float], duration: float) -> None:
    """Raise HardwareError for pulls (m) and a duration (s) that are not a valid motion."""
    if len(pulls) != len(tendons):
        raise HardwareError(
            f'{len(pulls)} pulls were given; needed: one for each of {", ".join(tendons)}')
    if not all(isfinite(x) for x in (*pulls, duration)) or duration < 0.0:
        raise HardwareError(f'not a motion: pulls {pulls} m in {duration} s')


def check_limits(tendons: Sequence[str], pulls: Sequence[float], present: Sequence[float],
                 limits: Sequence[float]) -> None:
    """
    Raise HardwareError for pulls (m) beyond pull_limits (low, high).

    present: where the tendons are, m.  A tendon that is beyond them, after a failure or a change
    of limits, may move anywhere that is not further beyond.
    """
    low, high = limits
    for pull, at in zip(pulls, present, strict=True):
        least = at - MAX_AHEAD if at < low else low - ROUNDING
        most = at + MAX_AHEAD if at > high else high + ROUNDING
        if not least <= pull <= most:
            raise HardwareError(f'pulls of {describe_pulls(tendons, pulls)} are beyond '
                                f'pull_limits: {low:g} to {high:g} m')


@dataclass(frozen=True)
class Accuracy:
    """
    Accuracy of a device, one value per tendon; empty: given by parameters.

    pull_tolerances: largest position error of a tendon at rest, m.
    tension_stddevs: standard deviation of a tension near 0, N.  tension_relative_stddevs: part
    proportional to the tension, relative; both add as squares.
    """

    pull_tolerances: tuple[float, ...] = ()
    tension_stddevs: tuple[float, ...] = ()
    tension_relative_stddevs: tuple[float, ...] = ()


@dataclass(frozen=True)
class TendonReading:
    """
    State of the motors, one value per tendon, in the order of the arm's ``tendon_names``.

    pulls: m, negative is paid out.  speeds: m/s.  tensions: N, None where nothing measures them.
    referenced: whether the pulls count from the straight arm.  unreferenced: why they do not, if
    the driver reports it.  accuracy: as far as the driver reports it.
    """

    pulls: tuple[float, ...]
    speeds: tuple[float, ...]
    referenced: bool
    tensions: tuple[float, ...] | None = None
    unreferenced: str = ''
    accuracy: Accuracy = Accuracy()

    @property
    def moving(self) -> bool:
        """Whether any tendon moves."""
        return any(speed != 0.0 for speed in self.speeds)


class TendonDriver(Protocol):
    """
    Steppers that pull the tendons.

    ``read``, ``move``, ``stop`` and ``reference`` never wait for the device: a control loop calls
    them, so they always return within a few milliseconds.  They raise HardwareError when the
    device has failed, is not open or is being opened.  ``open`` may take up to 6 s and ``close``
    up to 1 s (to stop moving tendons), on any thread; ``close`` during ``open`` makes that raise
    HardwareError.  A driver holds its tendons (motors energised) when it does not move them, also
    after close.
    """

    @property
    def reference_moves(self) -> bool:
        """Whether ``reference`` moves the tendons, to find their zero by switches."""

    def open(self) -> None:
        """Connect and read the present position; move nothing."""

    def close(self) -> None:
        """Stop, hold and disconnect."""

    def read(self) -> TendonReading:
        """Return the present state."""

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""

    def stop(self) -> None:
        """Brake as fast as possible without losing a step, then hold."""

    def reference(self) -> None:
        """
        Take the present position, the straight arm, as zero pull of all tendons, or search for it.

        A search only begins here: the reading is moving until the tendons rest at zero pull, or
        not referenced if the zero was not found.
        """


@dataclass(frozen=True)
class JammingReading:
    """
    State of pump, valves or regulators, and pressure sensors.

    pressures: absolute, Pa, per segment; nan from a broken sensor.  evacuated: per segment, valve
    open to the pump, as read back.  pump: whether it runs; False where the driver switches none.
    vacuums: per segment, set-point of its regulator as read back, Pa below the atmosphere; empty
    from valves.
    """

    pressures: tuple[float, ...]
    evacuated: tuple[bool, ...]
    pump: bool
    vacuums: tuple[float, ...] = ()

    @classmethod
    def of_regulators(cls, pressures: tuple[float, ...], vacuums: tuple[float, ...]) -> Self:
        """Return the reading of regulators: a set-point above 0 evacuates its segment."""
        return cls(pressures, tuple(vacuum > 0.0 for vacuum in vacuums), False, vacuums)


class JammingDriver(Protocol):
    """
    A vacuum pump with one valve and one pressure sensor per segment.

    ``read``, ``set_evacuated`` and ``set_pump`` return within some tens of milliseconds.  When a
    device does not answer they raise HardwareError after one bounded request, some 0.1 s; the next
    call tries again, and reopens a lost port.  ``open`` may take up to 6 s.  One thread calls all
    but ``close``, which any thread may call at any time.  A valve connects its segment to the pump
    or to the atmosphere and stays as it is on close.
    """

    def open(self) -> None:
        """Connect and read the present state; switch nothing."""

    def close(self) -> None:
        """Disconnect; leave pump and valves as they are."""

    def read(self) -> JammingReading:
        """Return the present state."""

    def set_evacuated(self, segment: int, evacuated: bool) -> None:
        """Connect a segment (0-based) to the pump or to the atmosphere."""

    def set_pump(self, running: bool) -> None:
        """Switch the pump."""


@runtime_checkable
class RegulatorDriver(Protocol):
    """
    A vacuum regulator and a pressure sensor per segment, in place of a pump and valves.

    A driver with ``set_vacuum`` is a RegulatorDriver; a class whose parameters choose between
    valves and regulators returns one of two classes from ``from_parameters``.  Timing, errors,
    threads, ``open``, ``read`` and ``close`` are those of a JammingDriver.  The vacuum supply of
    the regulators is not switched.  A regulator keeps its set-point on open, on close and without
    communication.
    """

    @property
    def max_vacuum(self) -> float:
        """Largest set-point, Pa below the atmosphere."""

    def open(self) -> None:
        """Connect and read the present state; set nothing."""

    def close(self) -> None:
        """Disconnect; leave the set-points as they are."""

    def read(self) -> JammingReading:
        """Return the present state, with set-points."""

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """
        Set the vacuum of a segment (0-based), Pa below the atmosphere, 0 to ``max_vacuum``.

        Raises HardwareError when another set-point is read back.
        """
