# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendons on a motor box with a network socket.

The box says every 10 ms where its motors are and whether they move, ``at 1 0.512 -0.498`` (mm),
and takes ``go 20 0.6 -0.6`` (where to be in 20 ms, mm) and ``hold``.  Without a ``go`` for 100 ms
it holds by itself.
"""

from contextlib import suppress
import socket
import threading

from soft_continuum.hardware.protocols import HardwareError, TendonReading
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import Parameter

MM = 1e3  # per m
OPEN_TIMEOUT, STOP_TIMEOUT = 2.0, 1.0  # s
REPORT_TIME = 0.05  # s after which a report surely knows of a command


class MotorBox:
    """A TendonDriver: see its docstrings for what the methods promise."""

    reference_moves = False  # zero is set by hand, not found by switches
    COMMISSIONING = 'my_tendons.commissioning'  # for doctor and calibrate
    EMULATOR = 'my_tendons.emulator'  # for emulate
    PARAMETERS = (
        Parameter('my_tendons.address', '127.0.0.1:4000', 'host and port of the motor box'),
        Parameter('my_tendons.timeout', 0.2, 'age at which its state is stale', 0.05, 1.0,
                  unit='s'),
    )

    @classmethod
    def from_parameters(cls, values, clock):
        """Return the driver that checked parameters describe; clock: steady time, s."""
        return cls(arm_from_parameters(values).tendon_names, values['my_tendons.address'],
                   values['my_tendons.timeout'], clock)

    def __init__(self, tendons, address, timeout, clock):
        """Describe the device; nothing is opened yet."""
        self._tendons, self._address = tendons, address
        self._timeout, self._clock = timeout, clock
        self._news = threading.Condition()  # for all that follows
        self._box = None
        self._closed = False
        self._forget()

    def _forget(self):
        self._at = None  # positions of the motors, m
        self._moving = False
        self._until = 0.0  # s, up to which it moves, whatever a report from before says
        self._heard = 0.0  # s, when the box said so
        self._zero = None  # positions of the motors when the arm is straight, m
        self._rest_by = None  # s, until when a stop must be confirmed

    def open(self):
        """Connect and read; move nothing."""
        host, _, port = self._address.partition(':')
        try:
            box = socket.create_connection((host, int(port)), OPEN_TIMEOUT)
        except (OSError, ValueError) as error:
            raise HardwareError(f'no motor box at {self._address} ({error}); check '
                                'my_tendons.address, and that it is switched on') from error
        box.settimeout(None)
        with self._news:
            self._box, self._closed = box, False
            self._forget()
            threading.Thread(target=self._receive, args=(box,), daemon=True).start()
            self._news.wait_for(lambda: self._at or self._closed, OPEN_TIMEOUT)
            heard = self._at is not None
        if not heard:
            self.close()
            raise HardwareError(f'the motor box at {self._address} does not say where its '
                                'motors are')

    def close(self):
        """Stop, hold and disconnect."""
        with self._news:
            self._closed = True
            self._news.notify_all()
            if self._box is not None:
                with suppress(HardwareError):  # it holds by itself
                    self._send('hold')
                self._box.close()
                self._box = None

    def _receive(self, box):
        """Keep what the box says: the thread that waits, so that no method has to."""
        for line in box.makefile(encoding='ascii', errors='replace'):
            try:
                word, moving, *positions = line.split()
                at = tuple(float(position) / MM for position in positions)
            except ValueError:
                continue  # a damaged line; its state becomes stale if they all are
            if word == 'at' and len(at) == len(self._tendons):
                with self._news:
                    self._at, self._moving, self._heard = at, moving == '1', self._clock()
                    self._news.notify_all()

    @property
    def age(self):
        """Age of the last report, s."""
        return self._clock() - self._heard

    def _check(self):
        if self._box is None:
            raise HardwareError('the motor box is not open; configure the node')
        if (age := self.age) > self._timeout:
            raise HardwareError(f'the motor box said nothing for {age:.2f} s; check its cable')

    def _send(self, line):
        try:
            self._box.sendall(f'{line}\n'.encode('ascii'))
        except OSError as error:
            raise HardwareError(f'the motor box cannot be reached: {error}') from error

    def read(self):
        """Return the present state."""
        with self._news:
            self._check()
            moving = self._moving or self._clock() < self._until
            if not moving:
                self._rest_by = None
            elif self._rest_by is not None and self._clock() > self._rest_by:
                raise HardwareError('the motors still move; cut their power')
            zero = self._zero or (0.0,) * len(self._at)
            speed = 1e-4 if moving else 0.0  # the box does not measure it
            return TendonReading(tuple(a - z for a, z in zip(self._at, zero, strict=True)),
                                 (speed,) * len(self._at), referenced=self._zero is not None)

    def move(self, pulls, duration):
        """Be at ``pulls`` (m) in ``duration`` (s)."""
        with self._news:
            self._check()
            if self._zero is None:
                raise HardwareError('the zero of the motor box is not known; call ~/reference')
            self._rest_by, self._until = None, self._clock() + duration + REPORT_TIME
            targets = (MM * (p + z) for p, z in zip(pulls, self._zero, strict=True))
            self._send(f'go {1e3 * duration:.0f} ' + ' '.join(f'{t:.4f}' for t in targets))

    def stop(self):
        """Brake and hold."""
        with self._news:
            self._check()
            self._rest_by = self._clock() + STOP_TIMEOUT
            self._send('hold')

    def reference(self):
        """Take the present position as zero pull."""
        with self._news:
            self._check()
            self._zero = self._at
