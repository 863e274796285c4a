"""An episode as an MP4 video, rendered by MuJoCo and encoded by ffmpeg."""

import contextlib
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from PIL import Image

from gplfd_env.envs.camera import Camera
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_policies.arrays.storage import complete_or_absent

SUFFIX: Final = ".mp4"

SIZE: Final = (640, 480)  # Width and height [px], multiples of 16.
RATE: Final = 25  # Images per second.
_PAUSE: Final = 1.0  # Additional time of the last image [s].


def video_paths(file: Path, doors: list[str]) -> dict[str, Path]:
    """Return the video of each door: the file, or FILE-DOOR.mp4 for several."""
    if file.suffix.lower() != SUFFIX:
        raise ValueError(
            f"--video writes {SUFFIX} files, got {str(file)!r}; give for example "
            f"--video {file.stem or 'opening'}{SUFFIX}"
        )
    several = len(doors) > 1
    paths = {d: file.with_stem(f"{file.stem}-{d}") if several else file for d in doors}
    for path in paths.values():
        if path.is_dir():
            raise ValueError(f"--video {path} is a folder; give the name of a file")
    return paths


def check_video() -> None:
    """Raise ModuleNotFoundError or OSError if no video can be made."""
    with optional_libraries("--video needs imageio-ffmpeg", "video"):
        import imageio_ffmpeg

    empty = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><camera name='any'/></worldbody></mujoco>"
    )
    camera = Camera(empty, 8, 8, "any", effects=False)
    try:
        imageio_ffmpeg.get_ffmpeg_exe()
        # GLFW's warnings say what the error says.
        with contextlib.closing(camera), warnings.catch_warnings(action="ignore"):
            camera.picture("rgb_array", mujoco.MjData(empty))
    except RuntimeError as error:
        raise OSError(f"--video: {error}") from error


def episode_images(
    log: EpisodeLog, model: Any, rows: Iterable[int], width: int, *, effects: bool
) -> Iterator[Image.Image]:
    """Yield 4:3 images from behind the robot, at rows of a log; may raise OSError."""
    data = mujoco.MjData(model)
    # Twice the size is drawn, for smooth edges. Without a graphics card, this takes a
    # quarter of the time of the renderer's antialiasing.
    camera = Camera(model, 2 * width, 3 * width // 2, "overview", effects=effects)
    with contextlib.closing(camera):
        for row in rows:
            data.qpos[:] = log.motion.qpos[row]
            mujoco.mj_forward(model, data)
            try:
                yield Image.fromarray(camera.picture("rgb_array", data)).reduce(2)
            except RuntimeError as error:
                raise OSError(f"an image was not drawn: {error}") from error


def write_video(path: Path, log: EpisodeLog, model: Any) -> int:
    """Write an episode, complete or not at all (`OSError`); return how many images."""
    import imageio_ffmpeg

    # The row of the log of each image, at k/rate and at the end.
    times = np.append(np.arange(0.0, log.times[-1], 1.0 / RATE), log.times[-1])
    rows = np.minimum(np.searchsorted(log.times, times), log.times.size - 1)
    pause = round(_PAUSE * RATE)
    with complete_or_absent(path) as temporary:
        # The temporary name has no suffix for the format.
        encoder = imageio_ffmpeg.write_frames(
            temporary, SIZE, fps=RATE, output_params=["-f", "mp4"]
        )
        with contextlib.closing(encoder):
            encoder.send(None)
            bar = progress_bar(rows, desc=path.name, unit=" images")
            for image in episode_images(log, model, bar, SIZE[0], effects=False):
                encoder.send(np.array(image))
            for _ in range(pause):
                encoder.send(np.array(image))
        # ffmpeg reports a full disk only on its standard error.
        written: int = imageio_ffmpeg.count_frames_and_secs(temporary)[0]
        if written != rows.size + pause:
            raise OSError(
                f"{path}: ffmpeg wrote {written} of {rows.size + pause} images; is "
                "there space on the disk?"
            )
    return written
