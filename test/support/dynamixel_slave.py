# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Servos of Protocol 2.0 on a pseudo-terminal, written for the tests of the driver alone.

They share nothing with the driver, the SDK of the maker or the emulator: packets, CRC (polynomial
0x8005, most significant bit first, from 0), byte stuffing and the addresses of registers are
written here once more, from the protocol page of the e-Manual.
"""

from contextlib import suppress
import os
import struct
import termios
import threading
import tty

STEP = 0.002  # s
STIFFNESS = 0.5  # counts of current per pulse between goal and position
RESPONSE = 50.0  # 1/s with which a servo follows its goal
SPEEDS = {termios.B57600: 57600, termios.B1000000: 1000000, termios.B115200: 115200}
FIELDS = {  # address: size
    0: 2, 6: 1, 7: 1, 8: 1, 9: 1, 10: 1, 11: 1, 12: 1, 13: 1, 20: 4, 36: 2, 38: 2, 44: 4, 60: 1,
    63: 1,
    64: 1, 65: 1, 68: 1, 70: 1, 84: 2, 98: 1, 100: 2, 102: 2, 104: 4, 108: 4, 112: 4, 116: 4,
    120: 2, 126: 2, 128: 4, 132: 4, 144: 2, 146: 1, 224: 4}
EEPROM = {10: 0, 11: 5, 12: 255, 13: 2, 20: 0, 36: 885, 38: 1193, 44: 1000, 60: 0, 63: 52, 9: 0}


def _crc_of(byte):
    crc = byte << 8
    for _ in range(8):
        crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


CRCS = [_crc_of(byte) for byte in range(256)]


def crc16(data):
    """CRC of a packet without its last two bytes."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ CRCS[crc >> 8 ^ byte]
    return crc


def packet(servo, instruction, parameters, stuffed=True):
    """A packet with its header, stuffing, length and CRC."""
    body = bytes([instruction]) + bytes(parameters)
    if stuffed:
        body = body.replace(b'\xff\xff\xfd', b'\xff\xff\xfd\xfd')
    data = b'\xff\xff\xfd\x00' + bytes([servo]) + struct.pack('<H', len(body) + 2) + body
    return data + struct.pack('<H', crc16(data))


class Slave:
    """One servo with a tendon: load is the current (counts) that the tendon needs, by pulse."""

    def __init__(self, servo, model=1020, firmware=48, protocol=2, **eeprom):
        self.id, self.model, self.firmware, self.protocol = servo, model, firmware, protocol
        self.eeprom = EEPROM | {int(key[1:]): value for key, value in eeprom.items()}
        self.turned = 1000.0  # pulses since ever
        self.load = lambda position: 0.0
        self.caught = self.ignores_writes = False
        self.table = bytearray(300)
        self.powered()

    def powered(self):
        """Switch on: what is in RAM is lost, and the turns."""
        self.table[64:] = bytes(len(self.table) - 64)
        for address, value in {0: self.model, 6: self.firmware, 7: self.id, **self.eeprom,
                               68: 2, 84: 800, 100: self.eeprom[36],
                               102: self.eeprom[38], 144: 120, 146: 30}.items():
            self.set(address, value)
        self.turns = -int(self.turned // 4096) * 4096
        self.current = self.speed = 0.0
        self.set(116, self.position)
        self.heard = 0.0

    @property
    def position(self):
        return int(self.turned // 1) + self.turns + self.eeprom[20]

    def get(self, address):
        size = FIELDS[address]
        return int.from_bytes(self.table[address:address + size], 'little',
                              signed=address in (20, 100, 102, 104, 116, 126, 128, 132))

    def set(self, address, value):
        size = FIELDS[address]
        self.table[address:address + size] = (value % (1 << 8 * size)).to_bytes(size, 'little')

    def step(self, now):
        """Let STEP pass."""
        watchdog = self.get(98)
        if self.get(64) and 0 < watchdog < 128 and now - self.heard > 0.02 * watchdog:
            self.set(98, 255)
            self.set(112, 0)
            self.set(116, self.position)
        error = self.get(116) - self.turned - self.turns - self.eeprom[20]
        limit = abs(self.get(102))
        self.current = max(-limit, min(limit, STIFFNESS * error)) if self.get(64) else 0.0
        push = self.current - self.load(self.turned)
        fastest = (self.get(112) or 2000) * 0.229 * 4096 / 60
        self.speed = max(-fastest, min(fastest, RESPONSE / STIFFNESS * push))
        if self.caught or not self.get(64):
            self.speed = 0.0
        self.turned += STEP * self.speed

    def shut_down(self, status):
        self.set(70, status)
        self.set(64, 0)

    def refresh(self, now):
        self.set(120, int(1000 * now) % 32768)
        self.set(126, round(self.current))
        self.set(132, self.position)

    def write(self, address, data):
        """Write whole registers; return the error."""
        if self.ignores_writes:
            return 0
        while data:
            size = FIELDS.get(address)
            if size is None or len(data) < size:
                return 5
            if address < 64:
                if self.get(64):
                    return 7
                self.eeprom[address] = int.from_bytes(data[:size], 'little')
            if address in (100, 102, 104, 116) and self.get(98) == 255:
                return 4
            if address == 64 and data[0] and self.get(70):
                return 1
            if address == 64 and data[0] and not self.get(64):
                self.set(116, self.position)
                self.table[64] = 1
            else:
                self.table[address:address + size] = data[:size]
            address, data = address + size, data[size:]
        return 0


class Bus:
    """Servos at ``port``, on a clock; lose, garble: how many of the next replies."""

    def __init__(self, slaves, clock, baud=1000000):
        self.slaves, self.clock, self.baud = slaves, clock, baud
        self.lock = threading.Lock()
        self.fast, self.deaf_to_writes, self.lose, self.garble = True, 0, 0, 0
        self.transform = None
        self.instructions = []
        self.dead = False
        self._fd, self._end = os.openpty()
        tty.setraw(self._end)
        self.port = os.ttyname(self._end)
        self._time = clock()
        self._data = b''
        self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self):
        while not self._closed:
            ready = self.clock.wait([self._fd], 0.02)
            with self.lock:
                self._advance()
                if ready:
                    with suppress(OSError):
                        self._data += os.read(self._fd, 4096)
                    self._answer()

    def _advance(self):
        now = self.clock()
        while self._time + STEP <= now:
            self._time += STEP
            for slave in self.slaves:
                slave.step(self._time)

    def now(self, function):
        """Do something between two moments of the servos."""
        with self.lock:
            self._advance()
            return function()

    def _answer(self):
        speed = SPEEDS.get(termios.tcgetattr(self._fd)[5])
        if speed != self.baud or self.dead:
            self._data = b''
            return
        if self._data[:2] == b'\xff\xff' and self._data[2:3] < b'\xfd' and len(self._data) >= 6:
            for slave in self.slaves:
                if slave.protocol == 1 and slave.id == self._data[2]:
                    reply = bytes([slave.id, 2, 0])
                    os.write(self._fd, b'\xff\xff' + reply + bytes([~sum(reply) & 255]))
            self._data = b''
        while (start := self._data.find(b'\xff\xff\xfd\x00')) >= 0:
            self._data = self._data[start:]
            if len(self._data) < 10:
                return
            size = 7 + struct.unpack('<H', self._data[5:7])[0]
            if len(self._data) < size:
                return
            one, self._data = self._data[:size], self._data[size:]
            if crc16(one[:-2]) == struct.unpack('<H', one[-2:])[0]:
                body = one[7:-2].replace(b'\xff\xff\xfd\xfd', b'\xff\xff\xfd')
                self._execute(one[4], body[0], body[1:])

    def _execute(self, target, instruction, data):
        self.instructions.append((target, instruction, data))
        heard = [slave for slave in self.slaves if slave.protocol == 2]
        for slave in heard:
            slave.heard = self._time
        replies = []
        if instruction in (0x82, 0x8A):  # sync read
            address, length = struct.unpack('<HH', data[:4])
            if instruction == 0x8A and not self.fast:
                return
            parts = []
            for servo in data[4:]:
                for slave in (s for s in heard if s.id == servo):
                    slave.refresh(self._time)
                    parts.append((slave, bytes(slave.table[address:address + length])))
            if len({s.id for s, _ in parts}) < len(data[4:]):
                parts = []
            if instruction == 0x82:
                replies = [self._status(s, part) for s, part in parts]
            elif parts:
                body = b''
                for i, (slave, part) in enumerate(parts):
                    body += bytes([0x80 if slave.get(70) else 0, slave.id]) + part
                    if i < len(parts) - 1:
                        body += b'\0\0'
                replies = [packet(254, 0x55, body, stuffed=False)]
        elif instruction == 0x83:  # sync write
            if self.deaf_to_writes:
                self.deaf_to_writes -= 1
                return
            address, length = struct.unpack('<HH', data[:4])
            rest = data[4:]
            while rest:
                for slave in (s for s in heard if s.id == rest[0]):
                    slave.write(address, rest[1:1 + length])
                rest = rest[1 + length:]
        else:
            asked = [s.id for s in heard] if (target, instruction) == (254, 1) else [target]
            for slave in (s for s in heard if s.id in asked):
                reply = self._execute_one(slave, instruction, data)
                if reply is not None:
                    replies.append(reply)
        for reply in replies:
            self._reply(reply)

    def _execute_one(self, slave, instruction, data):
        if instruction == 1:
            return self._status(slave, struct.pack('<HB', slave.model, slave.firmware))
        if instruction == 2:
            slave.refresh(self._time)
            address, length = struct.unpack('<HH', data)
            return self._status(slave, bytes(slave.table[address:address + length]))
        if instruction == 3:
            error = slave.write(struct.unpack('<H', data[:2])[0], data[2:])
            return self._status(slave, b'', error)
        if instruction == 8:
            slave.powered()
            return self._status(slave, b'')
        return None

    @staticmethod
    def _status(slave, data, error=0):
        alert = 0x80 if slave.get(70) else 0
        return packet(slave.id, 0x55, bytes([error | alert]) + data)

    def _reply(self, reply):
        if self.lose:
            self.lose -= 1
            return
        if self.garble:
            self.garble -= 1
            reply = reply[:9] + bytes([reply[9] ^ 0x10]) + reply[10:]
        if self.transform:
            reply = self.transform(reply)
        with suppress(OSError):
            os.write(self._fd, reply)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._closed = True
        while self._thread.is_alive():
            self.clock.sleep(0.01)
        for fd in (self._fd, self._end):
            with suppress(OSError):
                os.close(fd)
