"""Pictures of a scene: off screen by MuJoCo's renderer, in a window by Gymnasium's."""

from __future__ import annotations

from typing import Any, Final

import mujoco
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer

_LARGEST_PICTURE: Final = 8192
_EFFECTS: Final = (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION)


class Camera:
    """Draws a model's current state; a renderer is made when it is first needed.

    Args:
        model: The scene; it may be brought to another door in place.
        data: Its state.
        width: Of the picture [px].
        height: Of the picture [px].
        name: Of a camera in the model.
        effects: Shadows, reflections and smooth edges in pictures.

    Raises:
        ValueError: An impossible size or an unknown camera.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        width: int,
        height: int,
        name: str,
        *,
        effects: bool,
    ) -> None:
        _check_size(width, height)
        cameras = [model.camera(index).name for index in range(model.ncam)]
        check_choice("camera_name", name, cameras)
        self._model, self._data = model, data
        self._width, self._height, self._name = width, height, name
        self._effects = effects
        self._renderer: mujoco.Renderer | None = None
        self._window: MujocoRenderer | None = None

    def picture(self, mode: str) -> Any:
        """Return a picture in one of the environment's render modes.

        Raises:
            RuntimeError: OpenGL is not to be had; the message says what to install.
        """
        if mode == "human":
            return self._show()
        if mode == "rgb_array":
            return self._draw(depth=False)
        if mode == "depth_array":
            return self._draw(depth=True)
        return self._draw(depth=False), self._draw(depth=True)

    def close(self) -> None:
        """Free window and renderer; may be called more than once."""
        if self._window is not None:
            self._window.close()  # type: ignore[no-untyped-call]
            self._window = None
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _show(self) -> None:
        if self._window is None:
            self._window = MujocoRenderer(
                self._model,
                self._data,
                None,
                self._width,
                self._height,
                camera_name=self._name,
            )
        self._window.render("human")

    def _draw(self, *, depth: bool) -> Any:
        if self._renderer is None:
            self._renderer = self._made_renderer()
        renderer = self._renderer
        renderer.update_scene(self._data, camera=self._name)
        for flag in _EFFECTS:
            renderer.scene.flags[flag] = self._effects
        if depth:
            renderer.enable_depth_rendering()
        else:
            renderer.disable_depth_rendering()
        return renderer.render()

    def _made_renderer(self) -> mujoco.Renderer:
        visual, quality = self._model.vis.global_, self._model.vis.quality
        before = visual.offwidth, visual.offheight, quality.offsamples
        visual.offwidth = max(visual.offwidth, self._width)
        visual.offheight = max(visual.offheight, self._height)
        if not self._effects:
            quality.offsamples = 0
        try:
            return mujoco.Renderer(self._model, self._height, self._width)
        # Which exception depends on the platform's way of lacking OpenGL.
        except Exception as error:
            raise RuntimeError(
                f"no picture without OpenGL ({error}); on a machine without a screen "
                "set MUJOCO_GL=egl before Python starts (Debian, Ubuntu: apt-get "
                "install libegl1 libgl1-mesa-dri) or MUJOCO_GL=osmesa (libosmesa6)"
            ) from error
        finally:
            visual.offwidth, visual.offheight, quality.offsamples = before


def check_choice(name: str, value: object, allowed: Any) -> None:
    """Raise unless a value is one of those allowed.

    Raises:
        ValueError: It is not; the message lists them.
    """
    if value not in allowed:
        raise ValueError(
            f"{name} = {value!r} is not one of {', '.join(map(repr, allowed))}"
        )


def _check_size(width: int, height: int) -> None:
    for name, value in (("width", width), ("height", height)):
        if not isinstance(value, int) or not 1 <= value <= _LARGEST_PICTURE:
            raise ValueError(
                f"{name} = {value!r} must be a whole number of pixels from 1 to "
                f"{_LARGEST_PICTURE}"
            )
