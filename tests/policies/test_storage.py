"""Files that are complete or absent, and archives that are not trusted."""

import contextlib
import io
import json
import os
import stat
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from gplfd_policies.arrays.storage import (
    DecodingBudget,
    complete_or_absent,
    read_archive,
    settings,
    write_archive,
)

pytestmark = pytest.mark.slow

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
        build=lambda members: {name: members(name) for name in ARRAYS},
    )


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "archive.npz"
    write_archive(path, kind=KIND, version=3, arrays=ARRAYS)
    return path


def rewrite(path, compression=zipfile.ZIP_STORED, **members):
    """Replace members of an archive by bytes, or leave them out."""
    with zipfile.ZipFile(path) as old:
        kept = {info.filename: old.read(info) for info in old.infolist()}
    kept |= {f"{name}.npy": content for name, content in members.items()}
    with zipfile.ZipFile(path, "w", compression) as new:
        for name, content in kept.items():
            if content is not None:
                new.writestr(name, content)


def npy(array, **changed):
    """The bytes of a .npy file, with entries of its header changed."""
    header = np.lib.format.header_data_from_array_1_0(array) | changed
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + array.tobytes()


def refused(path, reason):
    return pytest.raises(
        ValueError,
        match=rf"{path.name} cannot be read as a test: .*{reason}.*make this one again",
    )


@contextlib.contextmanager
def taking_at_most(memory):
    tracemalloc.start()
    yield
    assert tracemalloc.get_traced_memory()[1] < memory
    tracemalloc.stop()


def test_content_appears_under_the_name_only_when_complete(tmp_path):
    """As readable by others as the umask allows; a killed process leaves no result."""
    target, plain = tmp_path / "new" / "file.json", tmp_path / "plain"
    plain.touch()
    with complete_or_absent(target) as temporary:
        temporary.write_text("half")
        assert [path.suffix for path in target.parent.iterdir()] == [".tmp"]
        temporary.write_text("whole")
    assert target.read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (target, plain)]
    assert modes[0] == modes[1]


def test_interruption_keeps_the_old_file_and_leaves_no_temporary(tmp_path):
    target = tmp_path / "file.txt"
    target.write_text("old")

    def write_half_and_stop():
        with complete_or_absent(target) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half_and_stop()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_archive_round_trip_is_exact(archive):
    found = read(archive)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        assert found[name].shape == array.shape
        assert np.array_equal(found[name], array)


def test_what_is_no_regular_file_is_refused_without_waiting(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no file .*nothing\.npz"):
        read(tmp_path / "nothing.npz")
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "zero.npz").symlink_to("/dev/zero")
    kinds = {"": "a folder", "pipe.npz": "a named pipe", "zero.npz": "a device"}
    for name, kind in kinds.items():
        with pytest.raises(ValueError, match=rf"{name} is {kind}; give a .* a test"):
            read(tmp_path / name)


@pytest.mark.parametrize("size", [0, 1, 200, -1])
def test_cut_archive(archive, size):
    archive.write_bytes(archive.read_bytes()[:size])
    with refused(archive, "File is not a zip file"):
        read(archive)


@pytest.mark.parametrize(
    ("kind", "version", "reason"),
    [
        ("another", 3, "it holds another"),
        (KIND, 4, "it has version 4, and this program reads version 3"),
        (None, None, "it holds something else"),
    ],
)
def test_another_kind_or_version(archive, kind, version, reason):
    if kind is None:
        np.savez(archive, a=np.zeros(3))
    else:
        write_archive(archive, kind=kind, version=version, arrays=ARRAYS)
    with refused(archive, reason):
        read(archive)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "it lacks 'curve'"),
        (b"", "magic string"),
        (npy(ARRAYS["curve"])[:-1], "'curve' is not as large as its header says"),
        (npy(ARRAYS["curve"], shape=(10**12,)), "'curve' is not as large as its"),
        (npy(np.zeros(0), shape=(0, 10**30)), ""),
        (npy(np.zeros(6), shape=(-2, -3)), ""),
        (npy(np.zeros(0), descr="<U0", shape=(10**12,)), "'curve' holds <U0"),
        (npy(np.zeros(3), descr="|O"), "'curve' holds object"),
        (npy(np.zeros(3), descr=[("a", "<f8")]), "'curve' holds .*not numbers"),
        (npy(np.zeros(3) * 1j), "'curve' holds complex128"),
        (npy(np.array("a")).replace(b"a\0\0\0", b"a999"), "'utf-32-le' codec can't"),
        (npy(np.array("\ud800")), "'utf-32-le' codec can't"),
        (npy(np.zeros(3)).replace(b"'<f8'", b"[[[[["), ""),
        (npy(np.zeros(3)).replace(b"'<f8'", b"{[]:1"), ""),
        (b"\x93NUMPY\x03\x00" + npy(np.zeros(3))[8:], "not an array of version 1.0"),
    ],
)
def test_wrong_member(archive, content, reason):
    rewrite(archive, curve=content)
    with refused(archive, reason):
        read(archive)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("bomb", "it holds 'bomb', which does not belong there"),
        ("curve", "it unpacks to more than its size allows"),
    ],
)
def test_a_large_member_is_refused_unread(archive, name, reason):
    rewrite(archive, zipfile.ZIP_DEFLATED, **{name: npy(np.zeros(2**27 // 8))})
    with taking_at_most(2**24), refused(archive, reason):
        read(archive)


def test_members_count_as_the_float64_that_they_become(archive):
    """A member of int8 is eight times as large as float64."""
    rewrite(archive, zipfile.ZIP_DEFLATED, curve=npy(np.zeros(2**24, dtype="i1")))
    with refused(archive, "unpacks to more than its size allows: with 'curve'"):
        read(archive)


def test_a_budget_is_shared_by_all_that_a_file_holds():
    budget = DecodingBudget(0)
    budget.claim(2**26 - 1, "a")
    with pytest.raises(ValueError, match=r"with b of 2 bytes .* 67,108,864 bytes"):
        budget.claim(2, "b")
    assert DecodingBudget(10**9).left == 20 * 10**9


def test_member_that_lies_about_its_size_is_not_unpacked_further(archive):
    rewrite(archive, zipfile.ZIP_DEFLATED, curve=npy(np.zeros(2**27 // 8)))
    with zipfile.ZipFile(archive) as whole:
        true = struct.pack("<L", whole.getinfo("curve.npy").file_size)
    archive.write_bytes(archive.read_bytes().replace(true, struct.pack("<L", 10**4)))
    with taking_at_most(2**24), refused(archive, "Bad CRC-32"):
        read(archive)


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_unusual_compression(archive, compression):
    rewrite(archive, compression)
    with refused(archive, "compressed in an unusual way"):
        read(archive)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_two_members_of_one_name(archive):
    with zipfile.ZipFile(archive, "a") as whole:
        whole.writestr("curve.npy", npy(np.zeros(3)))
    with refused(archive, "two members of one name"):
        read(archive)


def test_settings_are_a_json_object():
    assert settings(np.array(json.dumps({"a": 0.1}))) == {"a": 0.1}
    with pytest.raises(ValueError, match=r"must be a JSON object, got \[1\]"):
        settings(np.array("[1]"))


def mutated(content, rng):
    """Change, cut out, repeat or insert bytes somewhere."""
    start, stop = np.sort(rng.integers(0, len(content), 2))
    noise = rng.bytes(int(rng.integers(1, 9)))
    return (
        content[:start] + noise + content[start + len(noise) :],
        content[:start] + content[stop:],
        content[:stop] + content[start:],
        content[:start] + noise + content[start:],
    )[rng.integers(4)]


def damaged(archive, seed):
    """Mutate the file as it is, one of its members, or the header of one."""
    rng = np.random.default_rng(seed)
    if seed % 3 == 0:
        archive.write_bytes(mutated(archive.read_bytes(), rng))
        return
    with zipfile.ZipFile(archive) as whole:
        name = rng.choice(whole.namelist()).removesuffix(".npy")
        content = whole.read(f"{name}.npy")
    header = content if seed % 3 == 1 else content[:128]
    rewrite(archive, **{name: mutated(header, rng) + content[len(header) :]})


def outcome(archive):
    try:
        return set(read(archive))
    except ValueError as error:
        return str(error)


@pytest.mark.filterwarnings("default")  # as a user has them: a warning is no refusal
def test_whatever_is_in_a_file_it_is_read_rightly_or_refused_clearly(archive):
    """Not one of 300 damaged files ends in another error."""
    content, refusals = archive.read_bytes(), 0
    for seed in range(300):
        archive.write_bytes(content)
        damaged(archive, seed)
        found = outcome(archive)
        if found != set(ARRAYS):
            assert found.startswith(f"{archive} cannot be read as a test: ")
            refusals += 1
    assert 150 < refusals < 300
