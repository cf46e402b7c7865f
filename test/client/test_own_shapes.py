# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a user saves is found by every client, offered where it fits, and never lost."""

from math import radians
from multiprocessing import get_context

import pytest

from soft_continuum.client import own_file
from soft_continuum.client.own_file import (
    delete,
    OwnShapesError,
    read_saved,
    rename,
    save_sequence,
    save_shape,
    Saved,
    steps_from_text,
)
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import Shape

LIBRARY = ('c_form', 's_form')


@pytest.fixture(autouse=True)
def own(tmp_path, monkeypatch):
    """Return where the file of the user is, which is not there yet."""
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'config'))
    return tmp_path / 'config' / 'soft_continuum' / 'shapes.yaml'


def test_what_is_saved_is_read_as_it_was_and_nothing_is_there_at_first(own):
    assert read_saved() == Saved()
    save_shape('lean', (0.1, 1 / 3, -0.5))
    save_shape('twist', ((0.1, 2.0), (0.2, -1.0), (0.0, 0.0)))
    save_sequence('on', [('lean', 1.0), ('c_form', 0.25)], 0, LIBRARY)  # YAML reads on as true
    saved = read_saved()
    assert not saved.problem
    assert saved.shapes['lean'].angles == (0.1, 1 / 3, -0.5)
    assert saved.shapes['twist'].directions == (2.0, -1.0, 0.0)
    assert saved.sequences['on'].steps == (('lean', 1.0), ('c_form', 0.25))
    assert saved.sequences['on'].rounds == 0
    assert [path.name for path in own.parent.iterdir()] == ['shapes.yaml']


@pytest.mark.parametrize('name', ['', ' ', '9', '1e3', 'a b', 'a,b', 'ä', 'a\n', '../a', 'x' * 61,
                                  'c_form', 'wave'])
def test_a_name_that_is_none_or_taken_is_refused(name):
    save_shape('lean', (0.1,))
    save_sequence('wave', [('lean', 1.0)], 1)
    with pytest.raises(OwnShapesError):
        save_shape(name, (0.2,), LIBRARY)
    with pytest.raises(OwnShapesError):
        rename('shapes', 'lean', name, LIBRARY)
    assert read_saved().shapes.keys() == {'lean'}


def test_a_shape_that_is_renamed_stays_in_its_sequences_and_one_in_use_is_not_deleted():
    save_shape('lean', (0.1, 0.2))
    save_sequence('wave', [('lean', 1.0), ('lean', 2.0)], 3)
    rename('shapes', 'lean', 'bow')
    assert read_saved().sequences['wave'].steps == (('bow', 1.0), ('bow', 2.0))
    with pytest.raises(OwnShapesError, match='sequence wave'):
        delete('shapes', 'bow')
    delete('sequences', 'wave')
    assert '[0.1, 0.2]' in delete('shapes', 'bow')  # so that it can be typed in again
    assert not read_saved().names
    with pytest.raises(OwnShapesError, match='did you mean'):
        save_shape('bow', (0.1,))
        delete('shapes', 'bwo')


@pytest.mark.parametrize(('text', 'kept'), [
    ('version: 1\nshapes:\n  good: {bending_angles: [0.1]}\n  bad: {bending_angles: [a]}\n',
     {'good'}),
    ('version: 1\nshapes: {a: {bending_angles: [0.1]}, a: {bending_angles: [0.2]}}\n', set()),
    ('version: 1\nshapes: {good: {bending_angles: [0.1]}}\nsequences: {w: {rounds: 1, steps: 3}}',
     {'good'}),
    ('version: 1\nshapes: {both: {bending_angles: [0.1]}}\n'
     'sequences: {both: {rounds: 1, steps: [[both, 1.0]]}}', {'both'}),
    ('version: 2\nposes: {}\n', set()), ('version: 2\nshapes: {}\n', set()),
    ('shapes: {}', set()), ('- 1', set()), ('{', set()), ('', set()), ('\x00', set()),
    ('version: 1\nshapes: {a: {bending_angles: [.nan]}}', set()),
    ('version: 1\nshapes: [a]', set()), ('x' * 200_000, set()),
])
def test_a_file_that_cannot_be_read_whole_is_kept_aside_before_it_is_written(own, text, kept):
    own.parent.mkdir(parents=True)
    own.write_text(text, encoding='utf-8')
    saved = read_saved()
    assert saved.problem and str(own) in saved.problem and saved.names == kept
    assert own.read_text(encoding='utf-8') == text  # reading changes nothing
    done = save_shape('lean', (0.1,))
    aside = own.with_name('shapes.yaml.kept-1')
    assert aside.read_text(encoding='utf-8') == text and str(aside) in done
    assert read_saved().names == kept | {'lean'} and not read_saved().problem


def test_a_link_to_the_file_stays_one_and_a_file_that_cannot_be_written_is_said(own, tmp_path):
    own.parent.mkdir(parents=True)
    own.symlink_to(tmp_path / 'dotfiles.yaml')
    save_shape('lean', (0.1,))
    assert own.is_symlink() and 'lean' in (tmp_path / 'dotfiles.yaml').read_text()
    own.unlink()
    own.mkdir()
    with pytest.raises(OwnShapesError, match='cannot be'):
        save_shape('lean', (0.1,))


def _save_some(first):
    for number in range(first, first + 10):
        save_shape(f'shape_{number}', (0.1,))


def test_of_two_programs_that_save_at_once_neither_loses_what_the_other_saves():
    spawn = get_context('fork')
    others = [spawn.Process(target=_save_some, args=(10 * k,)) for k in range(2)]
    for other in others:
        other.start()
    for other in others:
        other.join()
    assert len(read_saved().shapes) == 20


def test_only_what_fits_an_arm_is_offered_to_it():
    planar, spatial = (load_arm(description_file().with_name(name))
                       for name in ('manipulator.yaml', 'tendon_arm.yaml'))
    save_shape('plane', (0.1, -0.2, 0.3))
    save_shape('space', ((0.1, 1.0), (0.2, 2.0), (0.3, 0.0)))
    save_shape('short', (0.1, 0.2))
    save_shape('far', (radians(170), 0.0, 0.0))
    save_sequence('both', [('plane', 1.0), ('space', 1.0)], 1)
    save_sequence('lean', [('plane', 1.0), ('c_form', 1.0)], 1, LIBRARY)
    saved = read_saved()
    assert saved.offered(planar, LIBRARY).names == {'plane', 'lean'}
    assert saved.offered(spatial, ()).names >= {'plane', 'space', 'both'}
    assert not saved.offered(spatial, ()).names & {'short', 'lean'}
    assert saved.offered(planar, ('plane', 'c_form')).names == {'lean'}  # the library comes first


def test_names_in_a_goal_are_looked_up_but_not_what_the_goal_says_itself():
    save_shape('lean', (0.1, 0.2))
    save_sequence('wave', [('lean', 1.5), ('c_form', 2.0)], 3, LIBRARY)
    given = [Shape(name='wave'), Shape(name='lean', bending_angles=[9.0]), Shape(name='x')]
    found = read_saved().replaced(given, LIBRARY)
    assert [(s.name, list(s.bending_angles), s.hold_time.sec) for s in found] == [
        ('lean', [0.1, 0.2], 1), ('c_form', [], 2), ('lean', [9.0], 0), ('x', [], 0)]
    assert read_saved().replaced([Shape(name='lean')], ('lean',)) == [Shape(name='lean')]


def test_steps_are_names_and_hold_times():
    assert steps_from_text(' c_form 2.5, lean,', 1.0) == [('c_form', 2.5), ('lean', 1.0)]
    for text in ('', ' , ', 'a b', 'a -1', 'a nan', 'a 1 2', 'a 1e9'):
        with pytest.raises(OwnShapesError):
            steps_from_text(text, 1.0)


def test_the_file_does_not_grow_beyond_what_can_be_read(monkeypatch):
    save_shape('lean', (0.1,))
    monkeypatch.setattr(own_file, 'MAX_SIZE', 150)
    with pytest.raises(OwnShapesError, match='delete something'):
        save_shape('long', (0.1,) * 50)
    assert read_saved().names == {'lean'}
