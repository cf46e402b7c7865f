# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The pages and files that the suite generates: in `test/`, `python -m recorded.record_pages`.

It writes those that are not there, and never over those that are.  Left out is what Matplotlib
draws, whose bytes are those of its version: pictures, tags, and the page of a recording.
"""

from collections.abc import Iterator
from contextlib import redirect_stdout
import io
from pathlib import Path
import tempfile

from soft_continuum.ros.description import load_arm
from soft_continuum.ros.urdf import arm_urdf
from soft_continuum.ui.cli.install_service import systemd_units
from soft_continuum.ui.cli.main import main as run_verb
from soft_continuum.ui.cli.reference import cells, markdown_table, parameter_tables

HERE = Path(__file__).resolve().parent
PAGES = HERE / 'pages'
CONFIG = HERE.parents[1] / 'config'
ARMS = 'manipulator', 'spatial_jamming', 'tendon_arm'
CHANGED = 'reach.states', 'reach.time_limit', 'reach.seed'
"""Parameters that are other ones since, on purpose: a search ends by states, not by time."""
COLUMNS = 'name', 'type', 'default', 'unit', 'range', 'read-only', 'description'
NEW_ARMS = {'planar': 3, 'spatial': 2, 'tendons': 2}  # segments


def pages() -> Iterator[tuple[str, str]]:
    """Yield the name of each page, and its text."""
    for name, parameters in parameter_tables():
        yield f'parameters_{name}', markdown_table(COLUMNS, (
            cells(one) for one in parameters if one.name not in CHANGED))
    for arm in ARMS:
        yield f'{arm}.urdf', arm_urdf(load_arm(CONFIG / f'{arm}.yaml'))
    with tempfile.TemporaryDirectory() as folder:
        for arm in ARMS:
            yield f'{arm}_policy.xml', _written(Path(folder) / arm, '.xml', [
                'policy', '--params-file', str(CONFIG / f'{arm}.yaml'), '--namespace', 'arm_1'])
        for kind, segments in NEW_ARMS.items():
            yield f'new_{kind}_arm.yaml', _written(Path(folder) / kind, '.yaml', [
                'new-arm', 'arm', '--yes', '--kind', kind, '--segments', str(segments)])
    for name, text in systemd_units('arm_1', ['tendon_actuation', 'kinematics'], [
            '/usr/bin/python3', '-m', 'soft_continuum', '%i', '--ros-args'],
            {'ROS_DOMAIN_ID': '7'}).items():
        yield name, text


def _written(folder: Path, suffix: str, words: list[str]) -> str:
    """Return what a verb writes into a file whose name ends so."""
    folder.mkdir()
    said = io.StringIO()
    with redirect_stdout(said):
        status = run_verb([*words, '--output', str(folder)])
    assert status == 0, said.getvalue()
    path, = folder.glob(f'*{suffix}')
    # Where it was written stands in the file of a new arm.
    return path.read_text(encoding='utf-8').replace(str(folder), 'FOLDER')


def main() -> None:
    """Write what is not there."""
    PAGES.mkdir(exist_ok=True)
    for name, text in pages():
        if not (PAGES / name).exists():
            (PAGES / name).write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main()
