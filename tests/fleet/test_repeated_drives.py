"""A recording and what compact or repair made of it are one drive."""

from typing import Any

from gateway.fleet.history_reading import without_repeats

S = 1_000_000_000
BEGIN = 1_700_000_000 * S


def row(path: str, begin_s: float = 0.0, end_s: float = 60.0, zero_s: float = -5.0, valid: int = 100) -> dict[str, Any]:
    begin, end, zero = (BEGIN + round(time * S) for time in (begin_s, end_s, zero_s))
    return {"path": path, "begin_utc": begin, "end_utc": end, "hub_zero_utc": zero, "revolutions_valid": valid}


def paths_of(*rows: dict[str, Any]) -> list[str]:
    return [str(item["path"]) for item in without_repeats(rows)[0]]


def test_an_original_and_its_copies_count_once():
    rows = row("/a/drive.compact.mcap"), row("/a/drive.mcap"), row("/a/repaired.mcap", end_s=40.0, valid=60)
    result, repeats = without_repeats(rows)
    assert [item["path"] for item in result] == ["/a/drive.mcap"]
    assert {(first["path"], other["path"]) for first, other in repeats} == {
        ("/a/drive.compact.mcap", "/a/drive.mcap"), ("/a/repaired.mcap", "/a/drive.mcap")
    }  # fmt: skip


def test_other_drives_count():
    first = row("/a/1.mcap")
    assert len(paths_of(first, row("/a/2.mcap", begin_s=60.0, end_s=120.0))) == 2  # the next part
    assert len(paths_of(first, row("/a/3.mcap", zero_s=-8.0))) == 2  # a recorder that begins at the same date each time
    assert len(paths_of(first, {**row("/a/4.mcap"), "hub_zero_utc": None})) == 2  # not known
