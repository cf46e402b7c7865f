# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is printed has the size it says, and a lens is found from pictures of the printed board."""

import cv2
from matplotlib.backends.backend_agg import FigureCanvasAgg
import numpy as np
import pytest

from soft_continuum.commissioning import calibrate
from soft_continuum.estimation.sensing import printing
from soft_continuum.estimation.sensing.lens import board, Lens
from soft_continuum.estimation.sensing.lens import calibrate as calibrate_lens
from soft_continuum.ui.cli.measure import tags
from support.views import space_views, views

DOTS = 6  # per mm
SIZE, FOCAL = (640, 480), 600.0


def printed(layout):
    """Return what a PDF gets, page by page, as grey pictures."""
    found = []

    class Pdf:
        def __init__(self, path):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def savefig(self, page):
            page.set_dpi(25.4 * DOTS)
            canvas = FigureCanvasAgg(page)
            canvas.draw()
            found.append(cv2.cvtColor(np.asarray(canvas.buffer_rgba()), cv2.COLOR_RGBA2GRAY))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(printing, 'PdfPages', Pdf)
        printing.write_tags('tags.pdf', layout)
    return found


@pytest.fixture(scope='module')
def pages():
    return printed(views.layout())


def test_every_tag_is_printed_in_its_size_on_a4(pages):
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    edges = {}
    for page in pages:
        assert page.shape[::-1] == pytest.approx((210 * DOTS, 297 * DOTS), abs=2)
        found, numbers, _ = detector.detectMarkers(page)
        for k in range(len(found)):
            corners = found[k].reshape(4, 2)
            assert corners[0, 1] < corners[3, 1]  # upright
            edges[int(numbers.ravel()[k])] = np.linalg.norm(
                np.diff(corners, axis=0), axis=1) / DOTS
    assert sorted(edges) == [0, 1, 2, 3, 100, 101, 102, 103]
    for number, sides in edges.items():
        assert sides == pytest.approx(60.0 if number >= 100 else 24.0, abs=0.25)


def test_a_strip_of_tags_folds_to_a_ring_that_goes_round_counterclockwise():
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    _, strips, *others = printed(space_views.layout())
    lying = np.rot90(strips, -1)  # z of the discs upwards: as who looks at a ring sees its faces
    found, numbers, _ = detector.detectMarkers(np.ascontiguousarray(lying))
    middles = {}
    for corners, number in zip(found, numbers.ravel(), strict=True):
        square = corners.reshape(4, 2)
        middles[int(number)] = square.mean(axis=0) / DOTS
        assert square[0, 1] < square[3, 1]  # upright
        assert np.linalg.norm(square - np.roll(square, 1, axis=0), axis=1) / DOTS == (
            pytest.approx(24.0, abs=0.25))
    assert sorted(middles) == list(range(24))
    for disc in range(4):
        steps = np.diff([middles[6 * disc + face] for face in range(6)], axis=0)
        assert steps == pytest.approx(np.tile([30.0, 0.0], (5, 1)), abs=0.1)  # to the right
    fixed = [detector.detectMarkers(page)[1] for page in others[:-1]]
    assert sorted(np.concatenate(fixed).ravel()) == list(range(100, 108))


def test_the_board_is_printed_as_it_is_detected(pages):
    corners, _, _, _ = cv2.aruco.CharucoDetector(board()).detectBoard(pages[-1])
    assert len(corners) == 48
    steps = np.linalg.norm(np.diff(corners.reshape(8, 6, 2), axis=1), axis=2)
    assert steps / DOTS == pytest.approx(25.0, abs=0.1)


def seen_board(turn, shift):
    """Return a picture of the board, turned (rad) and shifted (m) before a known camera."""
    dots = 60
    flat = cv2.copyMakeBorder(board().generateImage((7 * dots, 9 * dots)), 20, 20, 20, 20,
                              cv2.BORDER_CONSTANT, value=255)
    matrix = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])
    corners = np.array([(0, 0), (7, 0), (7, 9), (0, 9)], dtype=float) * 0.025
    middle = np.array([3.5, 4.5]) * 0.025
    solid = np.column_stack([corners - middle, np.zeros(4)])
    places = cv2.projectPoints(solid, np.array(turn), np.array(shift), matrix, None)[0]
    dots_at = corners / 0.025 * dots + 19.5
    turned = cv2.getPerspectiveTransform(dots_at.astype(np.float32),
                                         places.reshape(4, 2).astype(np.float32))
    return cv2.warpPerspective(flat, turned, SIZE, flags=cv2.INTER_AREA, borderValue=128)


@pytest.fixture(scope='module')
def boards():
    random = np.random.default_rng(1)
    return [seen_board(random.uniform(-0.5, 0.5, 3),
                       (*random.uniform(-0.12, 0.12, 2), random.uniform(0.3, 0.5)))
            for _ in range(20)]


def test_a_lens_is_found_from_pictures_of_the_board(boards, tmp_path, capsys):
    for n, picture in enumerate(boards):
        cv2.imwrite(str(tmp_path / f'{n}.png'), picture)
    assert calibrate.main(['camera', str(tmp_path), '--output', str(tmp_path)]) == 0
    lens = Lens.read(tmp_path / 'camera.yaml')
    assert lens.size == SIZE
    assert lens.matrix[[0, 1], [0, 1]] == pytest.approx(FOCAL, rel=0.01)
    assert lens.matrix[:2, 2] == pytest.approx((319.5, 239.5), abs=6)
    assert 'focal length' in capsys.readouterr().out


@pytest.mark.parametrize(('chosen', 'named'), [
    (lambda b: [], '0 of 0'), (lambda b: b[:3], '3 of 3'),
    (lambda b: b[:10] + [np.zeros((100, 100), np.uint8)], 'are mixed'),
    (lambda b: [seen_board((0.0, 0.0, 0.0), (0.0, 0.0, 0.5))] * 10, 'in the corners')])
def test_pictures_that_do_not_do_are_refused_with_the_remedy(boards, chosen, named):
    with pytest.raises(ValueError, match=named):
        calibrate_lens(chosen(boards))


@pytest.mark.parametrize('source', ['/nowhere', '/dev/video99', '.'])
def test_a_source_without_pictures_is_named(source, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert calibrate.main(['camera', source, '--output', str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert source in error or 'no images' in error
    assert 'Traceback' not in error


def test_the_command_writes_a_pdf_and_never_over_another_one(tmp_path, capsys):
    assert tags(['--output', str(tmp_path)]) == 0
    assert (tmp_path / 'tags.pdf').read_bytes().startswith(b'%PDF')
    assert tags(['--output', str(tmp_path)]) == 2
    assert '--force' in capsys.readouterr().err
    spatial = ['--params-file', str(space_views.PATH), '--output', str(tmp_path), '--force']
    assert tags(spatial) == 0
    assert '24 tags for discs and 8 fixed ones' in capsys.readouterr().out
