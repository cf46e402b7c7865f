# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Imports point one way: ``.importlinter`` says which."""

from functools import cache
from pathlib import Path
import re
import subprocess
import sys

import grimp
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).resolve().parent.parent


def test_rooms_import_only_what_is_below_them():
    linter = Path(sys.executable).with_name('lint-imports')
    done = subprocess.run([linter, '--no-cache'], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@cache
def imports():
    """Return the graph of all imports, those inside functions too."""
    return grimp.build_graph('soft_continuum', cache_dir=None)


DOORS = {'client': 12, 'commissioning': 0, 'estimation': 13, 'hardware': 13, 'lab': 5,
         'mechanics': 15, 'nodes': 4, 'parameters': 7, 'planning': 14, 'ros': 11, 'ros_topics': 0,
         'sequencing': 4, 'sim': 5, 'ui': 1}
"""Modules of each room that others import.  Lower it when one is closed; it never rises."""


def test_a_room_is_entered_by_few_of_its_modules():
    doors: dict[str, set[str]] = {room: set() for room in DOORS}
    for module in imports().modules:
        for name in imports().find_modules_directly_imported_by(module):
            room, own = ([*each.split('.'), ''][1] for each in (name, module))
            if room in doors and room != own:
                doors[room].add(name)
    assert {room: len(found) for room, found in doors.items()} == DOORS, doors


def test_no_module_imports_itself_through_others():
    graph = imports()
    names = sorted(graph.modules)
    row, column = np.array([
        (names.index(name), names.index(other)) for name in names
        for other in graph.find_modules_directly_imported_by(name)]).T
    count, circle_of = connected_components(
        coo_array((np.ones(len(row)), (row, column)), (len(names), len(names))),
        connection='strong')
    together: list[set[str]] = [set() for _ in range(count)]
    for name, circle in zip(names, circle_of, strict=True):
        together[circle].add(name.removeprefix('soft_continuum.'))
    assert not [each for each in together if len(each) > 1]


KIND = re.compile(r'isinstance\([^)]*\b(Plane|Space)?(Arm|Chain|Statics|Equilibrium)\b'
                  r'|\bSpatial[A-Z]|\b(Plane|Space)(Chain|Statics|Linearisation)\b|in_space'
                  r'|\bAny(?!omal)[A-Z]\w|\b(is_)?(planar|spatial)\s*(:\s*bool|=(?!=))|\bPAIR\b')
IN_OTHER_WORDS = re.compile(r'pose_axes(\[3:\])?\.(all|sum)\(\)|\bhinged\(|endswith\(.*_[xyz]\b')
MOST_IN_OTHER_WORDS = 10
"""Reads of what follows from the kind of an arm.  Lower it when one is gone; it never rises."""


def test_above_the_mechanics_nothing_asks_for_the_kind_of_an_arm():
    above = [path for path in (ROOT / 'soft_continuum').rglob('*.py')
             if path.relative_to(ROOT).parts[1] != 'mechanics']
    asking = [f'{path.relative_to(ROOT)}: {line.strip()}' for path in above
              for line in path.read_text(encoding='utf-8').splitlines() if KIND.search(line)]
    assert not asking
    texts = ''.join(path.read_text('utf-8') for path in above)
    assert len(re.findall(r'\.planar\b', texts)) <= 5
    assert len(IN_OTHER_WORDS.findall(texts)) == MOST_IN_OTHER_WORDS, 'set it to what is left'
