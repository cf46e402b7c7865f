# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Two computers and the cable between them: network namespaces, and a process that is the cable.

``Computers`` makes the namespaces ``rig`` and ``workstation``, of which each has one Ethernet
interface.  The other ends of these two are in a third namespace, where this file runs as a
program: it carries every frame from one to the other, late, or not at all.  Namespaces without a
name end with the processes in them, and these end when their standard input does: nothing is left.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import ctypes
from dataclasses import asdict, dataclass, replace
import fcntl
import heapq
import json
import os
from random import Random
import select
import socket
import struct
import subprocess
import sys
from time import monotonic
from typing import Any, Self

RIG, WORKSTATION = 'rig', 'workstation'
ADDRESSES = {RIG: '10.36.0.1', WORKSTATION: '10.36.0.2'}
ETH_P_ALL = 3
OUTGOING = 4  # PACKET_OUTGOING: a frame that was sent here, not received
SIOCETHTOOL, ETHTOOL_STXCSUM = 0x8946, 0x17
CLONE_NEWNET = 0x40000000
MAX_FRAME = 65536
TIMEOUT = 10.0  # s


@dataclass(frozen=True)
class Quality:
    """
    What the cable does to each frame, in each direction.

    delay: s.  jitter: s, by which a frame is up to so much earlier or later, and may overtake
    others.  loss: share of the frames.  cut: none arrive, nor those that are on their way.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    cut: bool = False


PERFECT = Quality()


def why_not() -> str:
    """Return why this process may not make namespaces; empty if it may."""
    try:
        done = subprocess.run(['unshare', '--net', '--uts', 'ip', 'link', 'show', 'lo'],
                              capture_output=True, text=True, timeout=TIMEOUT, check=False)
    except OSError as error:
        return f'unshare and ip (util-linux, iproute2) are needed: {error}'
    return done.stderr.strip() and f'no namespaces may be made here: {done.stderr.strip()}'


class Computer:
    """A network namespace with a host name, which a process holds open."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._holder = _start('unshare', '--net', '--uts', 'sh', '-c',
                              f'hostname {name} && ip link set lo up && echo up && exec cat')
        _expect(self._holder, 'up')

    @property
    def pid(self) -> int:
        """The process that is in it."""
        return self._holder.pid

    def command(self, *command: str) -> list[str]:
        """Return a command that runs on this computer."""
        return ['nsenter', '--target', str(self.pid), '--net', '--uts', *command]

    @contextmanager
    def inside(self) -> Iterator[None]:
        """Let sockets that this thread makes, and the threads that it starts, be of it."""
        with open('/proc/thread-self/ns/net') as before, open(f'/proc/{self.pid}/ns/net') as own:
            _enter(own.fileno())
            try:
                yield
            finally:
                _enter(before.fileno())

    def close(self) -> None:
        """End the process, and with it the namespace."""
        _end(self._holder)


def _enter(namespace: int) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    if library.setns(namespace, CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


class Computers:
    """A rig's computer and a workstation, and the cable between them."""

    def __init__(self, seed: int = 1) -> None:
        self.quality, self._open = PERFECT, []
        try:
            self.rig, self.workstation = map(self._opened, (Computer(RIG), Computer(WORKSTATION)))
            self._cable = _start('unshare', '--net', sys.executable, __file__, str(seed),
                                 str(self.rig.pid), str(self.workstation.pid))
            _expect(self._cable, 'up')
        except BaseException:
            self.close()
            raise

    def _opened(self, computer: Computer) -> Computer:
        self._open.append(computer)
        return computer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def set(self, quality: Quality) -> float:
        """Let the cable be like this; return since when it is, s (steady)."""
        self.quality = quality
        self._cable.stdin.write(json.dumps(asdict(quality)) + '\n')
        self._cable.stdin.flush()
        return float(_answer(self._cable))

    def cut(self) -> float:
        """Cut the cable; return when, s (steady)."""
        return self.set(replace(self.quality, cut=True))

    def mend(self) -> float:
        """Plug it in again; return when, s (steady)."""
        return self.set(replace(self.quality, cut=False))

    def close(self) -> None:
        """Leave nothing behind."""
        if hasattr(self, '_cable'):
            _end(self._cable)
        for computer in self._open:
            computer.close()


def _start(*command: str) -> 'subprocess.Popen[str]':
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def _answer(process: 'subprocess.Popen[str]') -> str:
    ready, _, _ = select.select([process.stdout], [], [], TIMEOUT)
    line = process.stdout.readline().strip() if ready else ''
    if not line:
        raise RuntimeError(f'{process.args} did not answer; see stderr')
    return line


def _expect(process: 'subprocess.Popen[str]', words: str) -> None:
    if (line := _answer(process)) != words:
        raise RuntimeError(f'{process.args} answered {line!r}')


def _end(process: 'subprocess.Popen[str]') -> None:
    with suppress(BrokenPipeError):
        process.stdin.close()
    try:
        process.wait(TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    process.stdout.close()


# The cable.

def _plug(name: str, pid: int, address: str) -> socket.socket:
    """Make an interface eth0 of the namespace of a process; return the socket of its other end."""
    _ip(f'link add {name} type veth peer name eth0')
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        # The kernel leaves checksums to the hardware, which this has not.
        off = ctypes.create_string_buffer(struct.pack('II', ETHTOOL_STXCSUM, 0))
        fcntl.ioctl(any_socket, SIOCETHTOOL,
                    struct.pack('16sP', b'eth0', ctypes.addressof(off)))
    _ip(f'link set eth0 netns {pid}')
    inside = ['nsenter', '--target', str(pid), '--net']
    _ip(f'address add {address}/24 dev eth0', inside)
    _ip('link set eth0 up', inside)
    _ip(f'link set {name} up')
    end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
    end.bind((name, 0))
    return end


def _ip(arguments: str, inside: list[str] | None = None) -> None:
    subprocess.run([*(inside or []), 'ip', *arguments.split()], check=True)


def carry(ends: list[socket.socket], random: Random, orders: Any) -> None:
    """Carry frames until ``orders`` ends, of which each line is a Quality."""
    quality, count = PERFECT, 0
    under_way: list[tuple[float, int, socket.socket, bytes]] = []
    watch = select.epoll()
    by_number = {end.fileno(): (end, other) for end, other in (ends, ends[::-1])}
    for number in (*by_number, orders.fileno()):
        watch.register(number, select.EPOLLIN)
    while True:
        wait = max(0.0, under_way[0][0] - monotonic()) if under_way else None
        for number, _ in watch.poll(wait):
            if number not in by_number:
                line = orders.readline()
                if not line:
                    return
                quality = Quality(**json.loads(line))
                if quality.cut:
                    under_way.clear()
                print(monotonic(), flush=True)
                continue
            end, other = by_number[number]
            frame, sender = end.recvfrom(MAX_FRAME)
            if sender[2] == OUTGOING or quality.cut or random.random() < quality.loss:
                continue
            count += 1
            due = monotonic() + quality.delay + quality.jitter * random.uniform(-1.0, 1.0)
            heapq.heappush(under_way, (due, count, other, frame))
        while under_way and under_way[0][0] <= monotonic():
            _, _, other, frame = heapq.heappop(under_way)
            with suppress(OSError):  # the interface is going down, or its queue is full
                other.send(frame)


if __name__ == '__main__':
    _seed, *_pids = map(int, sys.argv[1:])
    _ends = [_plug(name, pid, ADDRESSES[name])
             for name, pid in zip((RIG, WORKSTATION), _pids, strict=True)]
    print('up', flush=True)
    carry(_ends, Random(_seed), sys.stdin)
