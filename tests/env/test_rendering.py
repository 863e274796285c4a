"""Pictures: colour and depth without a screen."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from gplfd_env.spatial.se3 import handle_pose_on_arc

pytestmark = [pytest.mark.slow, pytest.mark.needs("opengl")]


@pytest.fixture
def show(start_env: Callable) -> Callable[..., Any]:
    """Return a function: an environment, just reset, that draws small pictures."""

    def shown(door: Any = "medium", **look: Any) -> Any:
        small = {"render_mode": "rgb_array", "width": 160, "height": 120}
        return start_env(door, **small | look)

    return shown


@pytest.mark.parametrize("camera", ["overview", "top", "head", "hand_camera"])
def test_colour_picture_from_every_camera(camera, show):
    image = show(camera_name=camera).render()
    assert (image.shape, image.dtype) == ((120, 160, 3), np.uint8)
    assert image.std() > 10, "something must be in the picture"


def test_pictures_show_the_door_and_are_reproducible(show):
    """Also after a reset, after closing, and of another door."""
    env = show()
    closed = env.render()
    assert np.array_equal(env.render(), closed)
    for step in range(200):
        env.step(handle_pose_on_arc(0.5, np.radians(15.0) * min(1.0, step / 150)))
    # One per cent of the picture and more than sensor-like noise.
    changed = np.abs(env.render().astype(int) - closed.astype(int)).max(axis=2) > 20
    assert changed.mean() > 0.01
    env.reset(seed=0)
    assert np.array_equal(env.render(), closed)
    env.close()
    env.close()
    assert np.array_equal(env.render(), closed)
    env.reset(options={"door": "large"})
    assert not np.array_equal(env.render(), closed)
    assert np.array_equal(env.render(), show("large").render())


def test_depth_is_in_metres_and_comes_with_colours(show):
    top = {"camera_name": "top"}
    env = show(render_mode="depth_array", **top)
    depth = env.render()
    assert (depth.shape, depth.dtype) == ((120, 160), np.float32)
    # The camera sees the floor and the lintel's top at 2.05 m.
    height = env.model.camera("top").pos[2]
    assert depth.max() == pytest.approx(height, abs=0.02)
    assert depth.min() == pytest.approx(height - 2.05, abs=0.02)
    colour, together = show(render_mode="rgbd_tuple", **top).render()
    assert np.array_equal(colour, show(**top).render())
    assert np.array_equal(together, depth)


@pytest.mark.parametrize(
    ("door", "base"),
    [("medium", "fixed"), ("room-834", "mobile"), ("barn-door", "mobile")],
)
def test_the_leaf_is_in_the_picture_and_not_at_its_border(door, base, start_env):
    env = start_env(door, base=base)
    with mujoco.Renderer(env.model, 120, 160) as renderer:
        renderer.enable_segmentation_rendering()
        for camera in ("overview", "top"):
            renderer.update_scene(env.data, camera)
            leaf = renderer.render()[..., 0] == env.model.geom("leaf").id
            assert leaf.sum() > 50, camera
            assert leaf.sum() == leaf[1:-1, 1:-1].sum(), camera
