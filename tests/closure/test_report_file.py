import errno
import os
from pathlib import Path

import pytest

from gateway.errors import OutputError
from gateway.views.output_file import check_target, write_whole
from gateway.views.report.diagnosis_json import write_json
from gateway.views.report.html import write_html
from tests.testkit.diagnosis_data import empty


@pytest.mark.parametrize("write", [write_html, write_json])
def test_absent_folder_names_the_mkdir_command(tmp_path, write):
    path = tmp_path / "absent" / "report"
    with pytest.raises(OutputError, match="absent") as caught:
        write(empty(), path)
    assert str(path) in str(caught.value)
    assert "mkdir -p" in caught.value.remedy


def test_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "out.json"
    path.write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left") as caught:
        write_whole(path, "new", force=True)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.json"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_full_device_is_an_error():
    with pytest.raises(OutputError, match="/dev/full"):
        write_whole(Path("/dev/full"), "text")


def test_device_is_written_not_replaced():
    write_whole(Path(os.devnull), "text")
    assert not Path(os.devnull).is_file()


def test_symlink_is_kept(tmp_path):
    (tmp_path / "real").write_text("old")
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "real")
    write_whole(link, "new", force=True)
    assert link.is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_file_mode_is_the_default(tmp_path):
    write_whole(tmp_path / "a", "text")
    (tmp_path / "b").write_text("text")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode


@pytest.mark.parametrize("name", ["", "x" * 300])
def test_unwritable_target_is_refused_early(tmp_path, name):
    with pytest.raises(OutputError) as caught:
        check_target(tmp_path / name)
    assert caught.value.remedy


def test_existing_target_is_refused_early(tmp_path):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(OutputError, match="already exists"):
        check_target(tmp_path / "out")
    check_target(tmp_path / "out", force=True)
    check_target(tmp_path / "new")
