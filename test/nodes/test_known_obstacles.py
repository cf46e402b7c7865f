# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles as topics have them: what a sequencer plans with is what others see of it."""

from pathlib import Path

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point
import numpy as np
import pytest
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.planning.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Mesh,
    Obstacle,
    Sphere,
    turned_by,
)
from soft_continuum.planning.obstacles.files import load_obstacles
from soft_continuum.ros.entries import OBSTACLES
from soft_continuum.ros.obstacles import (
    is_decoration,
    name_of,
    obstacle_from_ros,
    obstacle_to_ros,
    removal,
)
from support.ros_rig import LATCHED, set_in

EXAMPLE = Path(__file__).resolve().parents[2] / 'config' / 'obstacles_example.yaml'
TETRAHEDRON = Mesh(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]),
                   np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))


def ball(ns='ball', number=0, **fields):
    """Return a sphere beside the arm, as others send it."""
    marker = Marker(ns=ns, id=number, type=Marker.SPHERE)
    marker.header.frame_id = 'base_link'
    marker.pose.position.x = 0.3
    marker.scale.x = marker.scale.y = marker.scale.z = 0.1
    set_in(marker, **fields)
    return marker


@pytest.mark.parametrize('shape', [
    Sphere(0.03), Box((0.1, 0.2, 0.3)), Cylinder(0.02, 0.3), Capsule(0.02, 0.3), TETRAHEDRON],
    ids=lambda shape: shape.kind)
def test_an_obstacle_comes_back_from_its_markers(shape):
    here = Obstacle('shelf', shape, (0.1, -0.2, 0.3), turned_by(0.4, 0.5, 0.6))
    first, *others = obstacle_to_ros(('shelf', 0), here, 'base_link', Time())
    back = obstacle_from_ros(first, 'base_link')
    assert (back.name, back.position, back.orientation) == (
        here.name, here.position, here.orientation)
    if isinstance(shape, Mesh):
        assert abs(back.shape.volume) == pytest.approx(0.001 / 6)
        np.testing.assert_allclose(back.shape.bounds, shape.bounds)
    else:
        assert back.shape == shape
    assert [is_decoration(other) for other in others] == [True] * (2 * (shape.kind == 'capsule'))
    gone = {(marker.ns, marker.id) for marker in removal(('shelf', 0))}
    assert {(marker.ns, marker.id) for marker in (first, *others)} <= gone


def test_the_half_balls_of_a_capsule_are_at_its_ends():
    lying = Obstacle('pipe', Capsule(0.02, 0.3), (0.1, 0.0, 0.3), turned_by(0.0, np.pi / 2, 0.0))
    _, one, other = obstacle_to_ros(('pipe', 0), lying, 'base_link', Time())
    assert {round(end.pose.position.x, 9) for end in (one, other)} == {-0.05, 0.25}
    assert one.pose.position.z == pytest.approx(0.3)
    assert one.scale.x == pytest.approx(0.04)


class Topics:
    """A sequencer alone, what is sent to it, and what it publishes."""

    def __init__(self, rig):
        self.rig = rig
        rig.start('shape_sequencer', obstacles__file=str(EXAMPLE))
        self.publisher = rig.publisher(MarkerArray, 'obstacles', OBSTACLES)
        self.known = rig.record(MarkerArray, 'known_obstacles', LATCHED)
        rig.wait_for(lambda: len(self.known), 'known_obstacles')

    def send(self, *markers):
        """Publish markers; return what the sequencer says when it has refused them."""
        count = self.refusals()[0]
        self.publisher.publish(MarkerArray(markers=list(markers)))
        self.rig.wait_for(lambda: self.refusals()[0] > count, 'a refusal')
        return self.refusals()[1]

    def refusals(self):
        number, _, text = (self.rig.status_value('shape_sequencer', 'obstacles refused')
                           or '0, ').partition(', ')
        return int(number), text

    def change(self, *markers):
        """Publish markers that change something; return the names that are known then."""
        count = len(self.known)
        self.publisher.publish(MarkerArray(markers=list(markers)))
        self.rig.wait_for(lambda: len(self.known) > count, 'a change')
        return self.names

    @property
    def names(self):
        clear, *markers = self.known.last.markers
        assert clear.action == Marker.DELETEALL
        return [name_of((m.ns, m.id)) for m in markers if not is_decoration(m)]


@pytest.fixture(scope='module')
def sequencer(module_rig):
    """Return a sequencer that has read the example."""
    return Topics(module_rig)


def test_what_is_known_follows_the_topic(rig):
    sequencer, of_file = Topics(rig), [one.name for one in load_obstacles(EXAMPLE)]
    assert sequencer.names == of_file
    assert sequencer.change(ball(), ball(number=2), ball('b')) == [*of_file, 'ball', 'ball/2', 'b']
    assert sequencer.change(Marker(ns='ball', id=2, action=Marker.DELETE)) == [
        *of_file, 'ball', 'b']
    assert sequencer.change(Marker(ns='ball', action=Marker.DELETEALL), ball('c')) == [
        *of_file, 'b', 'c']
    assert sequencer.change(*removal(('pipe', 0))) == [
        *(name for name in of_file if name != 'pipe'), 'b', 'c']
    assert sequencer.change(Marker(action=Marker.DELETEALL)) == []
    sequencer.rig.wait_for(
        lambda: sequencer.rig.status_value('shape_sequencer', 'obstacles') == '0', 'none left')


def test_an_ellipsoid_is_known_as_the_ball_around_it(sequencer):
    sequencer.change(Marker(action=Marker.DELETEALL), ball(scale__y=0.2))
    assert sequencer.known.last.markers[1].scale.x == pytest.approx(0.2)


def test_a_lifetime_ends_an_obstacle(sequencer):
    sequencer.change(Marker(action=Marker.DELETEALL), ball('stays'))
    count = len(sequencer.known)
    sequencer.change(ball('goes', lifetime=Duration(nanosec=200_000_000)))
    sequencer.rig.wait_for(lambda: len(sequencer.known) > count + 1, 'its end')
    assert sequencer.names == ['stays']


@pytest.mark.parametrize(('sent', 'part'), [
    (ball(header__frame_id='map'), "frame_id is 'map'; allowed: 'base_link'. Transform it"),
    (ball(type=Marker.ARROW), 'type is 0; allowed: 2 (SPHERE), 1 (CUBE)'),
    (ball(action=1), 'action is 1'),
    (ball(scale__x=0.0), 'scale.x is 0.0'),
    (ball(scale__y=float('nan')), 'scale.y is nan'),
    (ball(pose__position__z=float('inf')), 'position is'),
    (ball(pose__orientation__w=0.5, pose__orientation__x=0.1), 'a unit quaternion'),
    (ball(type=Marker.TRIANGLE_LIST, points=[Point()] * 4), 'three make a triangle'),
    (ball(type=Marker.TRIANGLE_LIST, points=[Point(), Point(x=1.0), Point(y=1.0)] * 4), 'is open'),
    (ball(type=Marker.MESH_RESOURCE, mesh_resource='package://a/b.stl'), 'file:///PATH'),
    (ball(type=Marker.MESH_RESOURCE, mesh_resource='file:///none/b.stl'), 'No such file'),
    (ball(ns='a\nb'), 'a\\nb'),
    (ball(pose__position__x=0.0), 'in the base disc'),
], ids=lambda value: value if isinstance(value, str) else '')
def test_a_bad_message_changes_nothing_and_is_reported(sequencer, sent, part):
    before = len(sequencer.known)
    refused = sequencer.send(ball('good', 7), sent)
    assert part in refused
    assert len(sequencer.known) == before


def test_too_many_obstacles_are_refused(sequencer):
    sequencer.change(Marker(action=Marker.DELETEALL), ball('one'))
    assert '101 obstacles; allowed: 100' in sequencer.send(*(ball(number=k) for k in range(100)))
    assert sequencer.names == ['one']
