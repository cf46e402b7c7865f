# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Files of obstacles and of meshes: what they mean, and what is refused with which words."""

from pathlib import Path
import struct

import numpy as np
import pytest

from soft_continuum.planning.obstacles import Box, CollisionScene, ObstacleError, turned_by
from soft_continuum.planning.obstacles.files import load_mesh, load_obstacles
from soft_continuum.ros.description import load_arm

CONFIG = Path(__file__).parents[2] / 'config'
CUBE = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
FACES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]


def stl(corners):
    """Return triangles (m, 3, 3) as a binary STL file."""
    rows = [struct.pack('<12fH', 0, 0, 0, *np.ravel(triangle), 0) for triangle in corners]
    return b'cube'.ljust(80) + struct.pack('<I', len(rows)) + b''.join(rows)


def obj(vertices, faces):
    lines = ['v {} {} {}'.format(*v) for v in vertices]
    return '\n'.join(lines + ['f {} {} {}'.format(*(k + 1 for k in f)) for f in faces]).encode()


def ply(vertices, faces):
    return '\n'.join([
        'ply', 'format ascii 1.0', f'element vertex {len(vertices)}', 'property float x',
        'property float y', 'property float z', f'element face {len(faces)}',
        'property list uchar int vertex_indices', 'end_header',
        *(' '.join(map(str, v)) for v in vertices),
        *(' '.join(map(str, [3, *f])) for f in faces), '']).encode()


def cube(kind, size=0.1, faces=FACES):
    points = (np.array(CUBE) - 0.5) * size
    return {'stl': lambda: stl(points[faces]), 'obj': lambda: obj(points, faces),
            'ply': lambda: ply(points, faces)}[kind]()


def written(folder, text):
    path = folder / 'obstacles.yaml'
    path.write_text(text)
    return path


def test_the_example_is_read_in_metres_and_none_of_it_is_in_the_straight_arm():
    obstacles = load_obstacles(CONFIG / 'obstacles_example.yaml')
    assert [one.shape.kind for one in obstacles] == ['box', 'box', 'cylinder', 'capsule', 'sphere']
    assert obstacles[0].shape == Box((0.8, 0.6, 0.02))
    assert obstacles[1].position == pytest.approx((0.23, 0.0, 0.19))
    arm = load_arm(CONFIG / 'manipulator.yaml')
    assert CollisionScene(arm, obstacles).obstacles == obstacles


def test_turns_are_about_fixed_axes_one_after_another(tmp_path):
    path = written(tmp_path, 'obstacles: [{name: a, shape: sphere, radius: 1e-2, '
                             'rpy: [0.3, -0.5, 1.1]}]')
    (one,) = load_obstacles(path)
    turned = np.eye(3)
    for axis, angle in enumerate((0.3, -0.5, 1.1)):  # each about a fixed axis: from the left
        about, c, s = np.eye(3), np.cos(angle), np.sin(angle)
        j, k = (axis + 1) % 3, (axis + 2) % 3
        about[j, j] = about[k, k] = c
        about[k, j], about[j, k] = s, -s
        turned = about @ turned
    np.testing.assert_allclose(one.rotation, turned, atol=1e-12)
    assert one.orientation == turned_by(0.3, -0.5, 1.1)


@pytest.mark.parametrize('kind', ['stl', 'obj', 'ply'])
def test_a_mesh_is_found_beside_its_file_and_scaled_by_its_unit(tmp_path, kind):
    (tmp_path / f'part.{kind}').write_bytes(cube(kind, 100.0))
    (one,) = load_obstacles(written(
        tmp_path, f'unit: mm\nobstacles: [{{name: a, shape: mesh, file: part.{kind}}}]'))
    assert abs(one.shape.volume) == pytest.approx(1e-3)
    (two,) = load_obstacles(written(
        tmp_path, f'obstacles: [{{name: a, shape: mesh, file: part.{kind}, scale: 0.002}}]'))
    assert abs(two.shape.volume) == pytest.approx(8e-3)


@pytest.mark.parametrize(('text', 'parts'), [
    ('[]', ['the keys obstacles']),
    ('obstacles: [{name: a, shape: sphere, radius: 0.1}', ['not valid YAML']),
    ('unit: inch\nobstacles: []', ["'inch'", 'm or mm']),
    ('obstacles: 3', ['must be a list of 100']),
    ('obstacles: [3]', ['obstacle 1', 'give a mapping']),
    ('obstacles: [{name: a, shape: ball, radius: 1}]', ["'ball'", 'sphere, box']),
    ('obstacles: [{name: a, shape: sphere, radios: 1}]', ['(a)', 'did you mean radius?']),
    ('obstacles: [{name: a, shape: sphere}]', ['radius is missing']),
    ('obstacles: [{shape: sphere, radius: 0.1}]', ['name is missing']),
    ('obstacles: [{name: a, shape: sphere, radius: 0}]', ['radius is 0', '0.0001 to 100 m']),
    ('obstacles: [{name: a, shape: sphere, radius: .nan}]', ['radius is nan', 'finite']),
    ('obstacles: [{name: a, shape: sphere, radius: 300}]',
     ['radius is 300', '0.0001 to 100 m', 'in millimetres, give unit: mm']),
    ('obstacles: [{name: a, shape: box, size: [0.1, 0.0, 0.1]}]', ['size along y is 0']),
    ('obstacles: [{name: a, shape: box, size: 0.1}]', ['size is 0.1', 'three numbers']),
    ('obstacles: [{name: a, shape: sphere, radius: 1, position: [0, .inf, 0]}]', ['position']),
    ('obstacles: [{name: a, shape: box, size: [1, 1, 1], rpy: [0, 0, 90]}]',
     ['degrees? 90 degrees are 1.571 rad']),
    ('obstacles: [{name: "", shape: sphere, radius: 1}]', ['the name of an obstacle']),
    ('obstacles: [{name: a, shape: sphere, radius: 1}, {name: a, shape: sphere, radius: 1}]',
     ['two obstacles are named a']),
    ('obstacles: [{name: a, shape: mesh, file: none.stl}]', ['none.stl', 'No such file']),
    ('obstacles: [{name: a, shape: mesh, file: part.step}]', ["'.step'", '.stl, .obj, .ply']),
    ('obstacles: [{name: a, shape: mesh, file: part.stl, scale: -1}]', ['scale is -1']),
])
def test_what_is_wrong_with_a_file_is_said(tmp_path, text, parts):
    with pytest.raises(ObstacleError) as refused:
        load_obstacles(written(tmp_path, text))
    for part in ['obstacles.yaml', *parts]:
        assert part in str(refused.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ObstacleError, match='none.yaml: cannot be read'):
        load_obstacles(tmp_path / 'none.yaml')


@pytest.mark.parametrize(('name', 'data', 'part'), [
    ('open.stl', cube('stl', faces=FACES[:-1]), '3 of its edges'),
    ('turned.ply', cube('ply', faces=[FACES[0][::-1], *FACES[1:]]), 'face the same side'),
    ('nan.ply', cube('ply').replace(b'-0.05', b'nan', 1), 'not finite'),
    ('flat.obj', obj([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [2, 1, 0]] * 2), 'volume'),
    ('no.stl', b'<html>not found</html>', 'no triangle'),
    ('no.ply', b'<html>not found</html>', 'no PLY file'),
    ('far.obj', obj(np.array(CUBE) * 1e6, FACES), 'largest extent'),
    ('zero.stl', cube('stl', 0.0), '0 triangles'),
    ('mm.stl', cube('stl', 1500.0), 'unit: mm, or scale: 0.001'),
    ('commas.stl', b'solid\nfacet normal 0 0 0\nouter loop\nvertex 0,0 1,5 0,0\n'
     b'endloop\nendfacet\nendsolid\n', 'export it with points'),
])
def test_a_mesh_that_encloses_nothing_is_refused(tmp_path, name, data, part):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ObstacleError, match=name) as refused:
        load_mesh(tmp_path / name)
    assert part in str(refused.value)


def test_a_mesh_of_more_triangles_than_are_looked_at_is_refused(tmp_path):
    (tmp_path / 'fine.stl').write_bytes(stl(np.zeros((15_000, 3, 3)) + np.arange(3)[:, None]
                                            + np.arange(15_000)[:, None, None] * np.eye(3)[0]))
    with pytest.raises(ObstacleError, match='15000 triangles; allowed: 4 to 10000. Simplify'):
        load_mesh(tmp_path / 'fine.stl')


def test_a_mesh_in_millimetres_is_refused_with_its_size_and_what_to_do(tmp_path):
    (tmp_path / 'part.stl').write_bytes(cube('stl', 60.0))
    path = written(tmp_path, 'obstacles: [{name: part, shape: mesh, file: part.stl, '
                             'position: [0, 0, 200]}]')
    arm = load_arm(CONFIG / 'manipulator.yaml')
    with pytest.raises(ObstacleError, match='part is 60 x 60 x 60 m, .* scale: 0.001'):
        CollisionScene(arm, load_obstacles(path))


def test_a_material_that_a_mesh_names_is_not_read(tmp_path):
    (tmp_path / 'part.mtl').mkdir()  # to read it would fail
    (tmp_path / 'part.obj').write_bytes(b'mtllib part.mtl\nusemtl a\n' + cube('obj'))
    assert load_mesh(tmp_path / 'part.obj').volume != 0.0
