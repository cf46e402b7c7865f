# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Set the shapes of the library on the arm that runs, and write what it did as run.gif."""

from time import sleep

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np
from PIL import Image

from soft_continuum.client import Arm
from soft_continuum.mechanics import Chain
from soft_continuum.mechanics.drawing import draw_arm

PERIOD = 0.3  # s between two frames
FASTER = 2

looks = []
with Arm() as arm:
    chain = Chain(arm.description)
    running = arm.start(*arm.shapes, hold=1.5)
    while not running.done:
        if arm.state.joint_angles is not None:
            looks.append((arm.state, running.progress))
        sleep(PERIOD)
    running.result()

figure = Figure(figsize=(4.8, 4.4), layout='constrained')
canvas, axes = FigureCanvasAgg(figure), figure.subplots()
reach = 1.05e3 * chain.arm.length
images = []
for state, progress in looks:
    axes.clear()
    soft = [i for i, stiff in enumerate(state.stiff) if stiff is False]
    draw_arm(axes, chain.at(np.array(state.joint_angles)), soft)
    axes.set(xlim=(-0.35 * reach, 0.8 * reach), ylim=(-0.05 * reach, reach), ylabel='z in mm')
    phase = f'{progress.shape}: {progress.phase}' if progress else 'accepted'
    axes.set_title(f'{phase} segment {progress.segment}' if progress and progress.segment
                   else phase, parse_math=False)
    canvas.draw()
    figure.set_layout_engine('none')  # the room that the first one takes is kept
    images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert('RGB').quantize(24))
images[0].save('run.gif', save_all=True, append_images=images[1:], loop=0, optimize=True,
               duration=1e3 * PERIOD / FASTER)
print(f'{len(images)} frames: run.gif')
