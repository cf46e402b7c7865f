# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A message that names an option names one that its verb has.

The definitions that a verb can reach are followed by name, from its function on; so are the
options that they add to a parser.  Verbs of one function count together.
"""

import ast
from functools import cache
from pathlib import Path
import re

import pytest

from soft_continuum.lab.analysis import characterisation as characterize
from soft_continuum.lab.analysis import identification as identify
from soft_continuum.lab.analysis import validation as validate
from soft_continuum.parameters.arguments import Parser
from soft_continuum.ui.cli import plan
from soft_continuum.ui.cli.main import VERBS

PACKAGE = Path(__file__).parents[2] / 'soft_continuum'
OPTION = re.compile(r'(?<![\w-])--[a-z][a-z-]*')
OF_A_VERB = re.compile(r'(?:^|[\s`"])(?P<verb>[a-z][a-z_-]+) (?P<option>--[a-z-]+)')
"""Such as: `soft_continuum doctor --network`."""
OF_OTHERS = ('systemctl', 'udevadm', 'journalctl', 'pip', 'for a container', '--ros-args')
ADDED_BY = ('add_argument', 'Parser')
GROUPS_OF_OPTIONS = ('FOR_ANALYSIS', 'FOR_NODES')


@cache
def module(name):
    """Return the definitions of a module, by name, and where its names come from."""
    path = PACKAGE.joinpath(*name.split('.'))
    path = path / '__init__.py' if path.is_dir() else path.with_suffix('.py')
    if not path.is_file():
        return None
    tree = ast.parse(path.read_text(encoding='utf-8'))
    defined = {}
    for node in tree.body:
        names = ([node.name] if hasattr(node, 'name') else
                 [n.id for target in getattr(node, 'targets', [getattr(node, 'target', node)])
                  for n in ast.walk(target) if isinstance(n, ast.Name)])
        defined |= dict.fromkeys(names, node)
    imported = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('soft_continuum'):
            place = node.module.removeprefix('soft_continuum').lstrip('.')
            imported |= {a.asname or a.name: (place, a.name) for a in node.names}
    return defined, imported


@cache
def find(place, name, seen=()):
    """Return module and name of each definition of a name, through modules that pass it on."""
    if (place, name) in seen or module(place) is None:
        return ()
    defined, imported = module(place)
    if name in defined:
        return ((place, name),)
    if name in imported:
        return find(*imported[name], seen=(*seen, (place, name)))
    folder = PACKAGE / place.replace('.', '/')
    inner = [f'{place}.{path.stem}'.lstrip('.') for path in folder.glob('*.py')
             if path.stem != '__init__']  # of a package that loads lazily
    return tuple((one, name) for one in inner if module(one) and name in module(one)[0])


@cache
def uses(place, name):
    """Return the definitions that a definition names."""
    found = set()
    _, imported = module(place)
    for node in ast.walk(module(place)[0][name]):
        if isinstance(node, ast.Name):
            found.update(find(place, node.id))
        elif (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
                and node.value.id in imported):
            inner = '.'.join(filter(None, imported[node.value.id]))
            found.update(find(inner, node.attr))
    return found


@cache
def texts(place, name):
    """Return the options that a definition adds to a parser, and those that its messages name."""
    added, named, quiet = set(), [], set()
    for node in ast.walk(module(place)[0][name]):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and ast.get_docstring(node):
            quiet.add(id(node.body[0].value))
        if isinstance(node, ast.Call) and (getattr(node.func, 'attr', '') in ADDED_BY
                                           or getattr(node.func, 'id', '') in ADDED_BY
                                           or 'parser' in getattr(node.func, 'id', '')):
            for argument in node.args:
                if isinstance(argument, ast.Constant):
                    added.add(argument.value)
                elif isinstance(argument, ast.JoinedStr):
                    added.add(pattern(argument))
        if isinstance(node, (ast.JoinedStr, ast.Constant)) and id(node) not in quiet:
            if isinstance(node, ast.JoinedStr):
                quiet.update(id(part) for part in node.values)
                text = pattern(node)
            else:
                text = node.value
            if isinstance(text, str) and ' ' in text.strip():
                if '--' in text:
                    named.append((node.lineno, text))
            elif isinstance(text, str) and isinstance(node, ast.Constant):
                added.update(OPTION.findall(text) if name in GROUPS_OF_OPTIONS else ())
    return added, named


def pattern(node):
    """Return the text of an f-string, with ``{}`` for what is put in."""
    return ''.join(
        part.value if isinstance(part, ast.Constant) else
        part.value.args[0].value if ast.unparse(part.value).startswith("command_name('") else '{}'
        for part in node.values)


@cache
def reached(target):
    """Return the definitions that a function of a verb reaches."""
    place, _, name = target.partition(':')
    found, new = set(), set(find(place, name))
    while new:
        found |= new
        new = {used for one in new for used in uses(*one)} - found
    return frozenset(found)


@cache
def options(target):
    return frozenset().union({'--help'}, *(texts(*one)[0] for one in reached(target)))


TARGETS = {verb.target: verb for verb in VERBS.values()}


@pytest.mark.parametrize('target', TARGETS)
def test_messages_name_options_that_their_verb_has(target):
    wrong = []
    for place, name in sorted(reached(target)):
        for line, text in texts(place, name)[1]:
            if any(other in text for other in OF_OTHERS):
                continue
            of_verbs = {m['option']: m['verb'] for m in OF_A_VERB.finditer(text)
                        if m['verb'] in VERBS}
            for option in OPTION.findall(text):
                has = options(VERBS[of_verbs[option]].target if option in of_verbs else target)
                if not any(re.fullmatch(one.replace('{}', '.+'), option) for one in has
                           if isinstance(one, str)):
                    wrong.append(f'{place}, line {line}: {text!r} names {option}')
    assert not wrong, '\n'.join(wrong)


PULLS = 'shape;segment;right [mm];left [mm]\nbow;1;1,5;slack\n'
TABLES = {
    'characterize': (
        characterize, ('force [N]', 'displacement [mm]', 'time', 'cycle'),
        lambda path: [str(path), '--segment', '1', '--lever-arm', '0.025']),
    'validate': (validate, ('shape', 'point', 'x [mm]', 'z [mm]'), lambda path: [
        str(path), str(path.with_name('pulls.csv'))]),
    'identify': (identify, ('shape', 'point', 'x [mm]', 'z [mm]'), lambda path: [
        str(path), str(path.with_name('pulls.csv'))]),
    'plan': (plan, ('x [mm]', 'z [mm]', 'y [mm]', 'angle [deg]'), lambda path: [
        '--path', str(path), '--states', '10']),
}


def broken(header):
    """Yield tables that are refused, each for another reason."""
    head, row = ';'.join(header), ';'.join('1' for _ in header)
    yield ''
    yield '1;2\n'
    yield f'{head}\n'
    for cell in header:
        yield f'{head}\n{row}\n'.replace(cell, 'else', 1)  # no such column
        yield f'{head};{cell}\n{row};1\n'.replace('cycle', 'cycle x')  # two of them
        if '[' in cell:
            name = cell.split()[0]
            yield f'{head}\n{row}\n'.replace(cell, name, 1)  # no unit
            yield f'{head}\n{row}\n'.replace(cell, f'{name} [stone]', 1)
            yield f'{head}\n' + ';'.join('1.234' if c == cell else '1' for c in header)
    yield f'{head}\n{row};1\n'


@pytest.mark.parametrize('verb', TABLES)
def test_what_is_said_about_a_table_names_options_of_the_verb(tmp_path, capsys, monkeypatch, verb):
    command, header, arguments = TABLES[verb]
    made = []
    monkeypatch.setattr(Parser, 'parse_args', lambda self, *args, original=Parser.parse_args: (
        made.append(self), original(self, *args))[1])
    (tmp_path / 'pulls.csv').write_text(PULLS, encoding='utf-8')
    path, named = tmp_path / 'a.csv', set()
    for text in broken(header):
        path.write_text(text, encoding='utf-8')
        command.main([*arguments(path), *(() if verb == 'plan' else ('--output', str(tmp_path)))])
        named |= set(OPTION.findall(capsys.readouterr().err))
    assert '--decimal' in named
    assert not named - set(made[0]._option_string_actions)
    if verb == 'characterize':
        assert {'--force-column', '--displacement-column', '--force-unit'} <= named
