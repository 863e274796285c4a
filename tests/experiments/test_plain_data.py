"""JSON and TOML from anywhere: what is not plain data is refused with one error."""

import re

import pytest

from gplfd_experiments.files.plain_data import (
    entry,
    parsed_json,
    read_json,
    read_toml,
    write_json,
)


def test_json_comes_back(tmp_path):
    data = {"text": "größer ↦ \x7f", "numbers": [1, -2.5e300, 2**70, None, True]}
    write_json(tmp_path / "d.json", data)
    assert read_json(tmp_path / "d.json") == data


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"a": 1', "Expecting ',' delimiter"),
        (b"[1]", "holds [1], not an object in {braces}"),
        (b'{"a": "\xff"}', "can't decode byte 0xff"),
        (b'{"a": NaN}', "NaN, which is no number"),
    ],
)
def test_what_is_no_plain_object_is_refused(tmp_path, content, message):
    path = tmp_path / "d.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=re.escape(message)) as raised:
        read_json(path)
    assert str(raised.value).startswith(f"{path} cannot be read as JSON: ")


def test_a_folder_is_no_file(tmp_path):
    for read in (read_json, read_toml):
        with pytest.raises(FileNotFoundError, match=r"there is no file .*nothing"):
            read(tmp_path / "nothing")
        with pytest.raises(ValueError, match="is a folder; give a file"):
            read(tmp_path)


PLAIN = parsed_json(
    '{"n": 3, "x": 0.5, "t": "a", "all": [1, 2.5], "by": {"a": 1}, "yes": true,'
    ' "far": 1e999}'
)


@pytest.mark.parametrize(
    ("name", "kind", "value"),
    [
        ("n", int, 3),
        ("n", float, 3.0),
        ("t", int | str, "a"),
        ("all", tuple[float, ...], (1.0, 2.5)),
        ("by", dict[str, int | None], {"a": 1}),
    ],
)
def test_an_entry_is_taken_as_its_type(name, kind, value):
    found = entry(PLAIN, name, kind)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("name", "kind", "message"),
    [
        ("m", bool, "it lacks m, which must be true or false"),
        ("x", int, "x = 0.5 must be a whole number"),
        ("yes", float, "yes = True must be a number"),
        ("far", float, "far = inf must be a number"),
        ("t", float | None, "t = 'a' must be a number or null"),
        ("t", tuple[str, ...], "t = 'a' must be a list in [brackets], each of it a te"),
        ("by", dict[str, str], "by = {'a': 1} must be an object in {braces}"),
    ],
)
def test_an_entry_of_another_type_is_named(name, kind, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        entry(PLAIN, name, kind)
