# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Small drawings for the questions, for a terminal."""

DRAWINGS = {
    'segments': r"""
         [=====]   disc 2: the tip
          | : |
          | : |    segment 2
         [=====]   disc 1
          | : |
          | : |    segment 1
         [=====]   disc 0: the base
        /////////
""",
    'segment_lengths': r"""
         [=====]
          | : |  ^
          | : |  |  length
          | : |  v
         [=====]
""",
    'outer_diameters': r"""
         <----->   outer diameter
         [=====]
          | : |
          | : |
""",
    'disc_heights': r"""
          | : |
         +-----+  ^
         |     |  |  height
         +-----+  v
          | : |
""",
    'guide_offsets': r"""
         [=====]
         |  :  |   |  a tendon
         |  :  |   :  the backbone
         |  :  |
            <-->   offset
""",
    'spacers': r"""
         [=====]
          | : |
          |-:-|   spacer: tendons pass it
          | : |
          |-:-|   spacer
          | : |
         [=====]
""",
    'leaf_thicknesses': r"""
            ___________
           /          /|
          /__________/ |  ^
          |__________|/   v  thickness
          <---------->
              width
""",
    'rod_diameters': r"""
           ( )    rod
         ->| |<-  diameter
           | |
""",
    'tendon_ends': r"""
         [=====]   disc 2: tendon b ends here
          | : b
         [=a===]   disc 1: tendon a ends here
          |a: b
          |a: b
         [=====]   disc 0: the base
""",
    'first_tendon_angles': r"""
                y
                |
         2 o    |      seen from the tip:
                |      tendon 1 at its angle
          ------+---o 1 - x
                |
         3 o    |
""",
    'tendon_free_length': r"""
         [=====]   base
          |   |  ^
          |   |  |  free length
          |   |  v
         (motors)
""",
    'bending_angle_limits': r"""
               \   angle
          :     \ /
          :   /===/
          :  / /
          : | |
         [=====]
""",
    'mounting_angle': r"""
            0           90          180
            ^                     ////////
          [===]       /[=>         [===]
         ///////      /              v
""",
    'pull_limit': r"""
          |   |
         [=====]   base
          |   |
          |   v    pulled in
         (motors)
""",
}
"""By the names of questions; one similar to the previous question has none."""
