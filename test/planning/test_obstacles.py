# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles: their files, and distances between them and the arm."""

from dataclasses import replace
from math import inf, pi
from pathlib import Path
import struct
import subprocess
import sys

import numpy as np
import pytest

from soft_continuum.mechanics.chain import Chain
from soft_continuum.planning.obstacles import (
    Box,
    Capsule,
    Clearance,
    CollisionScene,
    Cylinder,
    Mesh,
    Obstacle,
    ObstacleError,
    Sphere,
    turned_by,
)
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


FILES = 'manipulator', 'tendon_arm', 'spatial_jamming'
GRID = 0.0017  # m: half the distance between two points of the cloud, and what mitres add


@pytest.fixture(scope='module', params=FILES)
def chain(request):
    return Chain(load_arm(CONFIG / f'{request.param}.yaml'))


def bent(chain, random):
    """Return a state whose joints all bend at random, up to the limits of the segments."""
    even = random.uniform(-0.07, 0.07, chain.coordinate_count // chain.joints_per_segment)
    joints = np.repeat(even, chain.joints_per_segment)
    return chain.state_of(
        joints + random.uniform(-0.02, 0.02, chain.coordinate_count),
        np.zeros(chain.coordinate_count), (False,) * chain.segments)


def cloud(chain, state):
    """Return points on the surface of discs and swept segments, by circles that turn along it."""
    turns = np.linspace(0.0, 2 * pi, 60, endpoint=False)
    circle = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    rotations = np.concatenate([np.eye(3)[None], state.rotations])
    ends, n = state.backbone, chain.joints_per_segment
    points = []
    for s, segment in enumerate(chain.arm.segments):
        for j in range(s * n, s * n + n):
            is_disc = j == s * n + n - 1
            radius = segment.outer_diameter / 2
            start = ends[j]
            if is_disc:  # all radii: its faces
                around = [chain.arm.segments[min(s + 1, chain.segments - 1)].outer_diameter / 2]
                rims = np.linspace(0.0, max(radius, *around), 15)[1:]
            else:  # in the joint below, the circle turns from one body to the next
                for part in np.linspace(0.0, 1.0, 5):
                    mixed = (1 - part) * rotations[j] + part * rotations[j + 1]
                    u, _, v = np.linalg.svd(mixed)
                    points.append(start + radius * circle @ (u @ v).T)
                rims = [radius]
            length = np.linalg.norm(ends[j + 1] - start)
            for height in np.linspace(0.0, length, 15 if is_disc else 5):
                faces = rims if is_disc and height in (0.0, length) else rims[-1:]
                for rim in faces:
                    points.append(start + (circle * rim + [0.0, 0.0, height]) @ rotations[j + 1].T)
    for guides in state.tendon_points:
        for one, other in zip(guides, guides[1:], strict=False):
            points.append(one + np.linspace(0.0, 1.0, 30)[:, None] * (other - one))
    return np.concatenate(points)


def to_sphere(local, shape):
    return np.linalg.norm(local, axis=1) - shape.radius


def to_box(local, shape):
    beyond = np.abs(local) - np.array(shape.size) / 2
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def to_cylinder(local, shape):
    beyond = np.stack([np.hypot(local[:, 0], local[:, 1]) - shape.radius,
                       np.abs(local[:, 2]) - shape.length / 2], axis=1)
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def to_capsule(local, shape):
    along = np.clip(local[:, 2], -shape.length / 2, shape.length / 2)
    return np.linalg.norm(local - along[:, None] * [0.0, 0.0, 1.0], axis=1) - shape.radius


SHAPES = [(Sphere(0.03), to_sphere), (Box((0.06, 0.3, 0.02)), to_box),
          (Cylinder(0.02, 0.1), to_cylinder), (Capsule(0.01, 0.2), to_capsule)]


@pytest.mark.parametrize(('shape', 'formula'), SHAPES)
def test_the_distance_is_that_of_a_dense_cloud_of_points_and_never_larger(chain, shape, formula):
    random = np.random.default_rng(7)
    left = 6
    for _ in range(12):
        if not left:
            break
        state = bent(chain, random)
        points = cloud(chain, state)
        place = state.backbone[-12] + random.normal(size=3) * 0.06
        if place[2] < 0.08:
            continue
        obstacle = Obstacle('it', shape, tuple(place), turned_by(*random.uniform(-3.0, 3.0, 3)))
        local = (points - place) @ obstacle.rotation
        true = formula(local, shape).min()
        try:
            found = CollisionScene(chain.arm, [obstacle]).clearance(state)
        except ObstacleError:  # it is in the base
            continue
        left -= 1
        assert found.obstacle == 'it'
        if true > GRID:
            assert found.distance <= true
            assert found.distance >= true - GRID
        else:
            assert found.distance <= GRID
    assert not left


def test_the_nearest_of_many_obstacles_is_the_nearest_of_each_alone(chain):
    random = np.random.default_rng(3)
    several = [Obstacle(f'{k}', shape, tuple(random.uniform(0.1, 0.3, 3)),
                        turned_by(*random.uniform(-3.0, 3.0, 3)))
               for k, (shape, _) in enumerate(SHAPES)]
    together = CollisionScene(chain.arm, several)
    alone = [CollisionScene(chain.arm, [one]) for one in several]
    states = [bent(chain, random) for _ in range(10)]
    for state, found in zip(states, together.clearances(states), strict=True):
        best = min((one.clearance(state) for one in alone), key=lambda c: c.distance)
        assert found == best


def test_without_obstacles_the_distance_is_infinite(chain):
    assert CollisionScene(chain.arm).clearance(chain.straight()) == Clearance(inf, '')


def box_mesh(size):
    """Return a box as a mesh."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                      [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    return Mesh(corners * size, faces)


def bowl():
    """Return a box that is open above, along y: BOWL, as one mesh that is not convex."""
    outline = np.array([[-3, -2], [3, -2], [3, 2], [2, 2], [2, -1], [-2, -1], [-2, 2], [-3, 2]])
    flat = [[0, 1, 4], [1, 2, 3], [1, 3, 4], [0, 4, 5], [0, 5, 6], [0, 6, 7]]
    near, far = (np.insert(outline / 20, 1, y, axis=1) for y in (-0.1, 0.1))
    sides = [[k, 8 + k, (k + 1) % 8] for k in range(8)]
    sides += [[(k + 1) % 8, 8 + k, 8 + (k + 1) % 8] for k in range(8)]
    return Mesh(np.concatenate([near, far]), np.array(
        flat + [[8 + c, 8 + b, 8 + a] for a, b, c in flat] + sides))


BOWL = [Box((0.3, 0.2, 0.05)), Box((0.05, 0.2, 0.2)), Box((0.05, 0.2, 0.2))]
PLACES = [(0.0, 0.0, -0.075), (0.125, 0.0, 0.0), (-0.125, 0.0, 0.0)]


def test_a_mesh_is_as_far_as_the_shapes_that_fill_it(chain):
    random = np.random.default_rng(5)
    middle, turn = np.array([0.05, 0.02, 0.42]), turned_by(0.4, 2.8, 0.3)  # above, open downwards
    frame = Obstacle('frame', Sphere(1.0), tuple(middle), turn).rotation
    several = [Obstacle(f'{k}', box, tuple(middle + frame @ place), turn)
               for k, (box, place) in enumerate(zip(BOWL, PLACES, strict=True))]
    of_boxes = CollisionScene(chain.arm, several)
    of_mesh = CollisionScene(chain.arm, [Obstacle('bowl', bowl(), tuple(middle), turn)])
    signs = set()
    for _ in range(15):
        state = bent(chain, random)
        found, wanted = of_mesh.clearance(state).distance, of_boxes.clearance(state).distance
        assert (found > 0) == (wanted > 0)
        if wanted > 0:
            assert found == pytest.approx(wanted, abs=1e-5)
        signs.add(wanted > 0)
    assert True in signs


def test_an_arm_that_reaches_through_a_mesh_is_not_clear_of_it(chain):
    straight = chain.straight()
    tip = Obstacle('tip', bowl(), (0.0, 0.0, straight.backbone[-1][2] - 0.04))
    assert CollisionScene(chain.arm, [tip]).clearance(straight).distance < 0


@pytest.mark.parametrize(('shape', 'z'), [
    (Sphere(0.01), 0.005), (Box((0.2, 0.2, 0.1)), 0.05), (box_mesh((1, 1, 1)), 0.0),
    (bowl(), 0.075), (Mesh(5 * bowl().vertices, bowl().triangles), 0.39)],
    ids=['sphere', 'box', 'mesh around it', 'bottom of a bowl', 'within that of a large one'])
def test_an_obstacle_in_the_base_disc_is_refused(chain, shape, z):
    place = (0.0, 0.0, z)
    with pytest.raises(ObstacleError, match='obstacle it is in the base disc'):
        CollisionScene(chain.arm, [Obstacle('it', shape, place)])


def test_the_arm_may_stand_on_a_table_that_is_an_obstacle(chain):
    table = Obstacle('table', Box((1.0, 1.0, 0.1)), (0.0, 0.0, -0.05))
    height = chain.arm.discs[0].height
    found = CollisionScene(chain.arm, [table]).clearance(chain.straight()).distance
    assert found == pytest.approx(height, abs=1e-5)  # from the top of the base disc
    with pytest.raises(ObstacleError, match='base disc'):
        CollisionScene(chain.arm, [Obstacle('table', Box((1.0, 1.0, 0.1)), (0.0, 0.0, -0.045))])


def test_a_mirrored_arm_is_as_far_from_mirrored_obstacles(chain):
    random = np.random.default_rng(11)
    if chain.joint_axes == ('y',):  # x to -x, which is the other side of its plane
        turns, mirror = -np.ones(chain.coordinate_count), np.array([-1.0, 1.0, 1.0])
    else:  # y to -y, where its tendons have their mirror images
        turns = np.tile([-1.0, 1.0, -1.0], chain.coordinate_count // 3)
        mirror = np.array([1.0, -1.0, 1.0])
    for shape in (Sphere(0.03), Capsule(0.02, 0.2), Box((0.1, 0.2, 0.3))):  # as their own images
        place = np.array([0.2, 0.1, 0.3])
        here = CollisionScene(chain.arm, [Obstacle('it', shape, tuple(place))])
        there = CollisionScene(chain.arm, [Obstacle('it', shape, tuple(mirror * place))])
        for _ in range(5):
            state = bent(chain, random)
            image = chain.state_of(turns * state.coordinates, state.held_coordinates, state.stiff)
            one, other = here.clearance(state).distance, there.clearance(image).distance
            assert (one > 0) == (other > 0)
            assert one == pytest.approx(other, abs=5e-6) or one < 0


def test_the_outside_of_a_sharp_bend_belongs_to_the_arm(chain):
    # Where one straight body meets the next one, the cylinders around them leave a wedge open.
    axes, radius = len(chain.joint_axes), chain.arm.segments[0].outer_diameter / 2
    outside = np.array([-np.cos(0.15), 0.0, np.sin(0.15)])  # halfway between the bodies
    for joint in (0, 1, chain.joints_per_segment - 1):  # on the base, in between, at a disc
        joints = np.zeros((chain.coordinate_count // axes, axes))
        joints[joint, axes // 2] = 0.3
        state = chain.state_of(joints.ravel(), joints.ravel(), (False,) * chain.segments)
        place = state.backbone[joint] + (radius + 0.004) * outside
        needle = Obstacle('needle', Sphere(0.001), tuple(place))
        found = CollisionScene(chain.arm, [needle]).clearance(state).distance
        assert found <= 0.003
        assert found > 0.003 - 2.0 * radius * (1.0 / np.cos(0.15) - 1.0)


def test_guides_outside_of_the_segments_belong_to_the_arm():
    arm = load_arm(CONFIG / 'tendon_arm.yaml')  # 20 mm thick, with spacers
    wide = replace(arm, tendons=tuple(replace(tendon, offset=0.015) for tendon in arm.tendons))
    straight = Chain(wide).straight()
    x, y = 0.03 * np.cos(pi / 9), 0.03 * np.sin(pi / 9)  # between two tendons
    beside = [Obstacle('it', Sphere(0.005), (x, y, z)) for z in (0.05, 0.0925)]
    for one in beside:  # a segment, a disc
        assert CollisionScene(wide, [one]).clearance(straight).distance == pytest.approx(
            0.01, abs=1e-5)
        assert CollisionScene(arm, [one]).clearance(Chain(arm).straight()
                                                  ).distance == pytest.approx(0.015, abs=1e-5)


def test_without_obstacles_nothing_of_coal_is_loaded():
    # It takes memory and time of every start.
    script = ('import sys; from soft_continuum.planning.obstacles import CollisionScene; '
              'from soft_continuum.ros.description import load_arm; '
              'CollisionScene(load_arm(sys.argv[1])); '
              'print(*sys.modules)')
    done = subprocess.run([sys.executable, '-c', script, CONFIG / 'manipulator.yaml'],
                          capture_output=True, text=True, check=True)
    assert {'coal', 'trimesh'}.isdisjoint(done.stdout.split())
