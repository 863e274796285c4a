"""Files that are complete or absent, and archives of arrays."""

import numpy as np
import pytest

from gplfd_policies.arrays.storage import (
    complete_or_absent,
    read_archive,
    write_archive,
)

KIND = "a test"
ARRAYS = {
    "curve": np.linspace(0.0, 1.0, 60).reshape(10, 6),
    "empty": np.zeros((0, 3)),
    "flags": np.array([True, False]),
    "name": np.array("größer"),
    "fortran": np.asfortranarray(np.arange(6).reshape(2, 3)),
}


def read(path):
    return read_archive(
        path,
        kind=KIND,
        version=3,
        build=lambda members: {name: members[name] for name in ARRAYS},
    )


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "archive.npz"
    write_archive(path, kind=KIND, version=3, arrays=ARRAYS)
    return path


def test_content_appears_under_the_name_only_when_complete(tmp_path):
    target = tmp_path / "new" / "file.json"
    with complete_or_absent(target) as temporary:
        temporary.write_text("half")
        assert [path.suffix for path in target.parent.iterdir()] == [".tmp"]
        temporary.write_text("whole")
    assert target.read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]


def test_archive_round_trip_is_exact(archive):
    arrays = read(archive)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        assert np.array_equal(arrays[name], array)


def test_a_folder_or_no_file_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no file .*nothing\.npz"):
        read(tmp_path / "nothing.npz")
    with pytest.raises(ValueError, match=r"is a folder; give a .* a test"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("kind", "version", "arrays", "reason"),
    [
        ("another", 3, ARRAYS, "it holds another"),
        (KIND, 4, ARRAYS, "it has version 4, and this program reads version 3"),
        (KIND, 3, {}, "it lacks 'curve'"),
        (KIND, 3, ARRAYS | {"curve": np.array([{}])}, "Object arrays cannot be loaded"),
        (b"", None, None, "it is no complete .npz archive"),  # cut
        (b"x,y,z\n0,0,0\n", None, None, "it is no complete .npz archive"),
    ],
)
def test_a_file_with_other_content_is_refused(archive, kind, version, arrays, reason):
    if isinstance(kind, bytes):
        archive.write_bytes(kind or archive.read_bytes()[:200])
    else:
        write_archive(archive, kind=kind, version=version, arrays=arrays)
    message = f"archive.npz cannot be read as a test: .*{reason}.*make this one again"
    with pytest.raises(ValueError, match=message):
        read(archive)
