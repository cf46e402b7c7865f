# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a driver of tendon steppers and a driver of jamming valves must do."""

from dataclasses import dataclass
from typing import Protocol


class HardwareError(RuntimeError):
    """A device does not do what it should; the message says which, how, and what to do."""


@dataclass(frozen=True)
class TendonReading:
    """
    State of the right and the left stepper.

    pulls: m, negative is let out.  speeds: m/s.  tensions: N, None where nothing measures them.
    referenced: whether the pulls are known relative to the straight arm.
    """

    pulls: tuple[float, float]
    speeds: tuple[float, float]
    referenced: bool
    tensions: tuple[float, float] | None = None

    @property
    def moving(self) -> bool:
        """Whether either tendon moves."""
        return any(speed != 0.0 for speed in self.speeds)


class TendonDriver(Protocol):
    """
    Two steppers that pull the right and the left tendon.

    Calls return within a few milliseconds and raise HardwareError when the device fails.  A
    driver holds its tendons (motors energised) whenever it does not move them, also after close.
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

    def move(self, pulls: tuple[float, float], duration: float) -> None:
        """Move both tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""

    def stop(self) -> None:
        """Brake as fast as no step is lost, then hold."""

    def reference(self) -> None:
        """
        Take the present position, the straight arm, as zero pull of both tendons, or look for it.

        A driver that looks for it begins to, and reads as moving until the tendons rest at zero
        pull, or not referenced until it gave up.
        """


@dataclass(frozen=True)
class JammingReading:
    """
    State of pump, valves and pressure sensors.

    pressures: absolute, Pa, per segment; nan from a broken sensor.  evacuated: per segment, valve
    open to the pump, as read back.  pump: whether it runs.
    """

    pressures: tuple[float, ...]
    evacuated: tuple[bool, ...]
    pump: bool


class JammingDriver(Protocol):
    """
    A vacuum pump with one valve and one pressure sensor per segment.

    Calls return within some tens of milliseconds and raise HardwareError when the device fails;
    the next call tries again, and opens a port again that was lost.  A valve connects its segment
    to the pump or to the atmosphere and stays as it is on close.
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
