"""Pictures of a scene: off screen by MuJoCo's renderer, in a window by Gymnasium's."""

import warnings
from typing import Any, ClassVar, Final

import mujoco

from gplfd_env.validation.fields import Range, check_choice, checked_count

_SIZES: Final = Range(unit="pixels", low=1, high=8192)
_EFFECTS: Final = (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION)


class Camera:
    """Renders the state of a model, off screen or in a window; a copy opens its own."""

    _without_opengl: ClassVar[str] = ""
    """Error message if OpenGL failed: a second try makes MuJoCo abort Python."""

    def __init__(
        self,
        model: mujoco.MjModel,
        width: int,
        height: int,
        name: str,
        *,
        effects: bool,
    ) -> None:
        self._width = checked_count("width", width, _SIZES)
        self._height = checked_count("height", height, _SIZES)
        cameras = [model.camera(index).name for index in range(model.ncam)]
        check_choice("camera_name", name, cameras)
        self._name, self._effects = name, effects
        self._renderer: mujoco.Renderer | None = None
        self._window: Any = None  # Gymnasium's, whose import loads GLFW.
        self._drawn: mujoco.MjModel | None = None

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_renderer": None, "_window": None, "_drawn": None}

    def picture(self, mode: str, data: mujoco.MjData) -> Any:
        """Return a picture in a render mode; raise a RuntimeError without OpenGL."""
        if mode == "human":
            if self._window is None or self._drawn is not data.model:
                from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer

                self.close()
                self._drawn = data.model
                scene = data.model, data, None, self._width, self._height
                self._window = MujocoRenderer(*scene, camera_name=self._name)
            return self._window.render("human")
        if mode == "rgbd_tuple":
            return self._draw(data, depth=False), self._draw(data, depth=True)
        return self._draw(data, depth=mode == "depth_array")

    def close(self) -> None:
        """Free window and renderer; may be called more than once."""
        if self._window is not None:
            self._window.close()
            self._window = None
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _draw(self, data: mujoco.MjData, *, depth: bool) -> Any:
        if self._renderer is None or self._drawn is not data.model:
            self.close()
            self._renderer, self._drawn = self._made_renderer(data.model), data.model
        renderer = self._renderer
        renderer.update_scene(data, camera=self._name)
        for flag in _EFFECTS:
            renderer.scene.flags[flag] = self._effects
        if depth:
            renderer.enable_depth_rendering()
        else:
            renderer.disable_depth_rendering()
        return renderer.render()

    def _made_renderer(self, model: mujoco.MjModel) -> mujoco.Renderer:
        if Camera._without_opengl:
            raise RuntimeError(Camera._without_opengl)
        visual, quality = model.vis.global_, model.vis.quality
        before = visual.offwidth, visual.offheight, quality.offsamples
        visual.offwidth = max(visual.offwidth, self._width)
        visual.offheight = max(visual.offheight, self._height)
        if not self._effects:
            quality.offsamples = 0
        try:
            return mujoco.Renderer(model, self._height, self._width)
        except Exception as error:  # Its type depends on the platform.
            Camera._without_opengl = (
                f"no picture without OpenGL ({error}); on a machine without a screen "
                "install EGL (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri "
                "libopengl0), or OSMesa (libosmesa6) with MUJOCO_GL=osmesa"
            )
            raise RuntimeError(Camera._without_opengl) from error
        finally:
            visual.offwidth, visual.offheight, quality.offsamples = before


def require_display() -> None:
    """Raise a RuntimeError without a display: a window would abort Python."""
    import glfw  # which starts a process to find its library

    with warnings.catch_warnings(action="ignore"):  # of GLFW, as the error below
        has_display = glfw.init() and glfw.get_primary_monitor()
    if not has_display:
        raise RuntimeError(
            'render_mode="human" needs a display; use "rgb_array" or xvfb-run'
        )
