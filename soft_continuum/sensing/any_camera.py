# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The tags, and what measures them, of the arm that is described: planar or spatial."""

from collections.abc import Mapping
from typing import Any, Protocol, TYPE_CHECKING

from soft_continuum.mechanics.spatial.arm import SpatialArm
from soft_continuum.parameters.arm import any_arm_from_parameters
from soft_continuum.sensing.layout import TagLayout
from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pictures import Array, Picture
from soft_continuum.sensing.ring_layout import RingLayout

if TYPE_CHECKING:  # OpenCV may not be there
    from soft_continuum.sensing.sight import Sight

AnyLayout = TagLayout | RingLayout


class AnyCamera(Protocol):
    """TagCamera or RingCamera: measures the discs in the pictures of one camera."""

    @property
    def layout(self) -> Any:
        """Where the tags are."""

    @property
    def lens(self) -> Lens:
        """Calibration of the camera."""

    def measure(self, picture: Picture) -> 'Sight':
        """Return what a grey picture (height, width) shows."""


def layout_of(values: Mapping[str, Any]) -> AnyLayout:
    """Return the tags that parameters arm.* and tags.* describe; raises ParameterError."""
    arm = any_arm_from_parameters(values)
    return RingLayout.of(values, arm) if isinstance(arm, SpatialArm) else TagLayout.of(values)


def camera_of(layout: AnyLayout, lens: Lens, straight: Mapping[int, Array] | None = None
              ) -> AnyCamera:
    """
    Return what measures the discs in the pictures of a camera; it needs OpenCV.

    straight: of a spatial arm, as of RingCamera.
    """
    if isinstance(layout, RingLayout):
        from soft_continuum.sensing.ring_camera import RingCamera
        return RingCamera(layout, lens, straight)
    from soft_continuum.sensing.tag_camera import TagCamera
    return TagCamera(layout, lens)
