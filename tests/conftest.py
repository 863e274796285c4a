"""Settings of the whole suite; nothing here imports MuJoCo."""

import os

from hypothesis import settings

if "DISPLAY" not in os.environ:
    # Read by MuJoCo when it is imported: without a display, pictures come from EGL.
    os.environ.setdefault("MUJOCO_GL", "egl")

# The same examples in every run, and no deadline: a first call may compile a scene.
settings.register_profile("suite", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("suite")
