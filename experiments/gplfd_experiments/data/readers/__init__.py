"""Readers of motion files: one module for each kind of file, one list of them all."""

from gplfd_experiments.data.raw import Selection
from gplfd_experiments.data.readers.guard import read_files, read_recordings

__all__ = ["Selection", "read_files", "read_recordings"]
