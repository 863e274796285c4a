"""An episode as an MP4 video: pictures by MuJoCo's renderer, encoded by ffmpeg."""

import contextlib
import importlib.util
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gplfd_experiments.console.progress import LOG, progress_bar
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.arrays.storage import complete_or_absent

SUFFIX: Final = ".mp4"
PICTURES_PER_SECOND: Final = 25
SIZE: Final = (640, 480)
"""Width and height [px]."""

_CAMERA: Final = "overview"
_LAST_PICTURE: Final = 1.0
"""How long the end of the episode is shown [s]."""
_OVERSAMPLING: Final = 2
"""Drawn pixels per pixel of the video, in each direction: this smooths edges, and
without a graphics card it takes a quarter of the time of the renderer's own."""


def video_paths(file: Path, doors: list[str]) -> dict[str, Path]:
    """Return the video of each door: the file, or one file per door beside it.

    Of several doors, `opening.mp4` becomes `opening-small.mp4`, `opening-large.mp4`.
    """
    if file.suffix.lower() != SUFFIX:
        raise ValueError(
            f"--video writes {SUFFIX} files, got {str(file)!r}; give for example "
            f"--video {file.stem or 'opening'}{SUFFIX}"
        )
    paths = {door: file.with_name(f"{file.stem}-{door}{file.suffix}") for door in doors}
    if len(doors) == 1:
        paths = {doors[0]: file}
    for path in paths.values():
        if path.is_dir():
            raise ValueError(f"--video {path} is a folder; give the name of a file")
    return paths


def check_video() -> None:
    """Raise ModuleNotFoundError or OSError where no video can be made."""
    import mujoco

    from gplfd_env.envs.camera import Camera

    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ModuleNotFoundError(
            "--video needs imageio-ffmpeg, which is not installed: "
            "pip install 'gplfd[video]'"
        )
    import imageio_ffmpeg

    empty = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><camera name='any'/></worldbody></mujoco>"
    )
    camera = Camera(empty, 8, 8, "any", effects=False)
    try:
        imageio_ffmpeg.get_ffmpeg_exe()
        with contextlib.closing(camera), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of GLFW, about what the error says
            camera.picture("rgb_array", mujoco.MjData(empty))
    except RuntimeError as error:
        raise OSError(f"--video: {error}") from error


def write_video(path: Path, log: EpisodeLog, model: Any) -> None:
    """Write an episode in real time, complete or not at all (`OSError`)."""
    import imageio_ffmpeg

    step = 1.0 / PICTURES_PER_SECOND
    times = np.append(np.arange(0.0, log.times[-1], step), log.times[-1])
    rows = np.minimum(np.searchsorted(log.times, times), log.times.size - 1)
    pause = round(_LAST_PICTURE * PICTURES_PER_SECOND)
    with complete_or_absent(path) as temporary:
        # The temporary name does not tell the format.
        encoder = imageio_ffmpeg.write_frames(
            temporary, SIZE, fps=PICTURES_PER_SECOND, output_params=["-f", "mp4"]
        )
        with contextlib.closing(encoder):
            encoder.send(None)
            pictures = _pictures(log, model, rows)
            for picture in progress_bar(
                pictures, total=rows.size, desc=path.name, unit=" pictures"
            ):
                encoder.send(picture)
            for _ in range(pause):
                encoder.send(picture)
        # ffmpeg reports a full disk on its standard error alone.
        there, _ = imageio_ffmpeg.count_frames_and_secs(temporary)
        if there != rows.size + pause:
            raise OSError(
                f"{path}: ffmpeg wrote {there} of {rows.size + pause} pictures; is "
                "there space on the disk?"
            )
    LOG.info("wrote %s (%d pictures, %.1f s)", path, there, there * step)


def _pictures(
    log: EpisodeLog, model: Any, rows: NDArray[np.intp]
) -> Iterator[NDArray[np.uint8]]:
    """Yield a picture (H, W, 3) of the scene in some rows of the log."""
    import mujoco

    from gplfd_env.envs.camera import Camera

    data = mujoco.MjData(model)
    width, height = (_OVERSAMPLING * side for side in SIZE)
    camera = Camera(model, width, height, _CAMERA, effects=False)
    with contextlib.closing(camera):
        for row in rows:
            data.qpos[:] = log.qpos[row]
            mujoco.mj_forward(model, data)
            try:
                drawn = camera.picture("rgb_array", data)
            except RuntimeError as error:
                raise OSError(f"--video: {error}") from error
            yield np.array(Image.fromarray(drawn).reduce(_OVERSAMPLING))
