"""Readers of motion files: one module for each kind of file, one list of them all."""

from gplfd_experiments.data.readers.guard import read_files, read_recordings
from gplfd_experiments.data.settings import ImportSettings

__all__ = ["ImportSettings", "read_files", "read_recordings"]
