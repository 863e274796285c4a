"""Episodes as a Minari data set (HDF5) that can be repeated step by step.

In addition to Minari's data of an episode (observations, actions, rewards, ends, infos,
seed, reset options), it contains the complete state of MuJoCo at every step, a hash of
the model, and the versions and kind of processor that computed it.
"""

from gplfd_experiments.files.libraries import optional_libraries

with optional_libraries("data sets need Minari and h5py", "minari"):
    from gplfd_experiments.data.minari.dataset import (
        Dataset,
        open_dataset,
        write_dataset,
    )
    from gplfd_experiments.data.minari.episode import RecordedEpisode, Recorder

__all__ = ["Dataset", "RecordedEpisode", "Recorder", "open_dataset", "write_dataset"]
