"""Coverage by room, from coverage's own report."""

import json

from tools.coverage_rooms import main, rooms


def report(**covered: int) -> dict[str, object]:
    summaries = {
        name: {"num_statements": 100, "covered_lines": lines, "num_branches": 10, "covered_branches": 9}
        for name, lines in covered.items()
    }
    return {"files": {f"gateway/{name}/a.py": {"summary": summary} for name, summary in summaries.items()}}


def test_files_of_a_room_are_added():
    data = report(**{"core/links": 90})
    data["files"]["gateway/core/links/deeper/b.py"] = {
        "summary": {"num_statements": 100, "covered_lines": 70, "num_branches": 0, "covered_branches": 0}
    }
    assert rooms(data)["gateway/core/links"] == (200, 160, 10, 9)


def test_a_room_below_is_named(tmp_path, capsys):
    path = tmp_path / "coverage.json"
    path.write_text(json.dumps(report(console=90, fleet=90, upkeep=84)))
    assert main([str(path)]) == 1
    assert "gateway/upkeep is below 85 %" in capsys.readouterr().out
    path.write_text(json.dumps(report(console=90, upkeep=85)))
    assert main([str(path)]) == 0
    path.write_text(json.dumps(report(console=90, importing=84)))
    assert main([str(path)]) == 0
    assert "gateway/importing may be below: readers" in capsys.readouterr().out
