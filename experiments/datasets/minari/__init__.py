"""Demonstrations as a Minari data set (HDF5) that can be re-run step by step.

Besides what Minari keeps of an episode (observations, actions, rewards, ends, infos,
seed, reset options), it holds MuJoCo's whole state at every step, a hash of the model,
and the versions and kind of processor that computed it.
"""

from experiments.datasets.minari.episode import Episode, Recorder
from experiments.datasets.minari.reading import Dataset, open_dataset
from experiments.datasets.minari.writing import new_dataset

__all__ = ["Dataset", "Episode", "Recorder", "new_dataset", "open_dataset"]
