"""JSON from outside: what is too large, too deep or no object is said in one line."""

from pathlib import Path

import pytest

from boxcal.target.errors import TargetError
from boxcal.target.files.json_document import MAX_DEPTH, parse_json, read_json


def refused(content: bytes, **options: int) -> str:
    with pytest.raises(TargetError) as error:
        parse_json(content, "a target", error=TargetError, source="x.json", remedy="make one", **options)
    return str(error.value)


def test_an_object_comes_back_whatever_its_strings_hold(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text('{"a": [1, {"b": "[[[[{{{{\\"]]"}], "c": "\\\\"}')
    assert read_json(path, "a target", error=TargetError, remedy="") == {"a": [1, {"b": '[[[[{{{{"]]'}], "c": "\\"}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"[1, 2]", "x.json: not a target; make one"),
        (b'{"a": 1', "x.json: not a whole JSON file"),
        (b'{"a": NaN}', "NaN is no JSON number"),
        (b"\xff\xfe", "x.json: not a whole JSON file"),
        (b"", "x.json: not a whole JSON file"),
        (b'{"a": ' + b"9" * 5000 + b"}", "x.json: not a whole JSON file"),
        (b'{"a":' * 100_000, f"x.json: nested deeper than {MAX_DEPTH} levels, a target is not; make one"),
        (b"[" * (MAX_DEPTH + 1), f"nested deeper than {MAX_DEPTH} levels"),
    ],
)
def test_what_is_no_sound_object_is_refused_in_one_line(content: bytes, says: str) -> None:
    text = refused(content)
    assert says in text
    assert "\n" not in text


def test_a_large_file_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    assert "larger than 10 bytes, a target is not" in refused(b'{"a": "0123456789"}', max_bytes=10)
    path = tmp_path / "large.json"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # sparse: reading it whole would not end
    with pytest.raises(TargetError, match="larger than"):
        read_json(path, "a target", error=TargetError, remedy="")
    with pytest.raises(TargetError, match=r"none\.json: cannot be read"):
        read_json(tmp_path / "none.json", "a target", error=TargetError, remedy="make one")
