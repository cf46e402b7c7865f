# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Jogs are written such that one damaged character makes none of them long."""

import random

from soft_continuum.emulators.grbl_firmware import GrblFirmware
from soft_continuum.hardware.grbl.link import G_WORDS, jog_line
from soft_continuum.hardware.grbl.motion import JogStream, Motors, subtract
from soft_continuum.hardware.grbl.setup import MODES
from support.grbl_rig import ACCELERATION, SPEED, STEPS_PER_MM, TENDONS

LONGEST = 5e-3 * 1e3 * STEPS_PER_MM  # steps
CHARACTERS = b'0159.+-XYZFGNMS$=(); \n\r?!~/\xff\x85'  # a reset, \x18, is another fault


def jogs(count, seed=0):
    """Jogs of motions of all speeds between random places."""
    chance = random.Random(seed)
    stream = JogStream(Motors(TENDONS, (STEPS_PER_MM,) * 2, (1.0, 1.0), SPEED, ACCELERATION,
                              (-0.06, 0.06)), ACCELERATION)
    now, made = 0.0, []
    while len(made) < count:
        target = tuple(chance.randint(-12000, 12000) for _ in TENDONS)
        stream.set_target(target, now + chance.choice((0.0, 2.0, 20.0)), now)
        for _ in range(chance.randint(5, 100)):
            now += chance.choice((0.005, 0.05))
            if jog := stream.next_jog(now):
                made.append(jog)
                stream.observe(jog.end, jog.speed)
                stream.clear_queue()
    return made[:count]


def damaged(line):
    """The line with each of its bytes lost, doubled and changed."""
    for i, byte in enumerate(line):
        for instead in (b'', bytes([byte, byte]), *(bytes([c]) for c in CHARACTERS)):
            yield line[:i] + instead + line[i + 1:]


def executed(firmware, start, line, state):
    """How far (steps) any motor would go when a line is received at a place and in a state."""
    firmware._restart()
    firmware.state = 'Idle'
    firmware.take(MODES.encode() + b'\n')
    ends = [start]
    firmware.planner.end = (*start, 0)
    firmware.planner.add = lambda target, feed: ends.append(tuple(target)[:2])
    firmware.state = state
    firmware.take(line)
    firmware.take(b'=\n')  # what the next connection sends
    return max(abs(way) for end in ends for way in subtract(end, start))


def test_no_damaged_character_makes_a_jog_longer_than_5_mm():
    firmware = GrblFirmware({}, lambda _: None, lambda _: None)
    for n, jog in enumerate(jogs(400)[::20]):
        line = jog_line(subtract(jog.end, jog.start), 60.0 * jog.feed).encode() + b'\n'
        state = ('Idle', 'Jog')[n % 2]
        assert executed(firmware, jog.start, line, 'Idle') == max(
            abs(way) for way in subtract(jog.end, jog.start))
        for wrong in damaged(line):
            assert executed(firmware, jog.start, wrong, state) <= LONGEST, wrong


def test_no_jog_has_a_number_that_a_damaged_letter_makes_a_mode():
    for jog in jogs(500, seed=1):
        assert not G_WORDS.intersection(subtract(jog.end, jog.start)), jog


def test_a_way_that_no_jog_may_make_is_made_by_two():
    stream = JogStream(Motors(TENDONS, (STEPS_PER_MM,) * 2, (1.0, 1.0), SPEED, ACCELERATION,
                              (-0.06, 0.06)), ACCELERATION)
    for way in G_WORDS:
        stream.place((0, 0))
        stream.set_target((way, -way), 0.0, 0.0)
        made = [jog for n in range(40) if (jog := stream.next_jog(0.02 * n))]
        assert made[-1].end == (way, -way)
