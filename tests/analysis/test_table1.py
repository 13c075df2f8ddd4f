"""Table 1 from timing.csv."""

from __future__ import annotations

import pytest

from skinrender.analysis.table1 import main, seconds_of, table
from skinrender.engine.clock import append_timing
from skinrender.errors import InputError


def write(folder, finished, **seconds):
    path = folder / "timing.csv"
    if not path.exists():
        path.write_text("finished,command,stage,seconds,workers\n", encoding="utf-8")
    with path.open("a", encoding="utf-8") as file:
        file.writelines(f"{finished},render,{stage},{spent},2\n" for stage, spent in seconds.items())


def test_the_newest_run_of_all_stages_counts(tmp_path):
    write(tmp_path, "10:00", load=9.0, trace=9.0, estimate=9.0, total=27.0)
    write(tmp_path, "11:00", load=1.0, trace=2.0, estimate=3.0, write=0.5, total=6.5)
    write(tmp_path, "12:00", load=0.1, estimate=4.0, total=4.1)
    assert seconds_of(tmp_path) == {"load": 1.0, "trace": 2.0, "estimate": 3.0, "write": 0.5, "total": 6.5}


def test_reads_what_the_commands_write(tmp_path):
    seconds = {"load": 1.0, "trace": 2.0, "estimate": 3.0, "total": 6.0}
    append_timing(tmp_path / "timing.csv", seconds, command="render", workers=2)
    assert seconds_of(tmp_path) == seconds


def test_table_stands_beside_the_papers_numbers():
    stages = {"load": 1.0, "trace": 2.0, "estimate": 4.0, "write": 0.5, "total": 7.5}
    lines = table(stages, stages | {"estimate": 3.0, "total": 6.5}).splitlines()
    assert lines[4] == "| estimate | 4.00 | 3.00 | 1.33 | 11754 | 1740 | 6.76 |"
    assert lines[5] == "| write | 0.50 | 0.50 | 1.00 |  |  |  |"
    assert lines[6] == "| total | 7.50 | 6.50 | 1.15 | 18030 | 8023 | 2.25 |"


def test_a_folder_without_all_stages_is_refused(tmp_path, capsys):
    with pytest.raises(InputError, match="no such file"):
        seconds_of(tmp_path)
    write(tmp_path, "10:00", load=1.0, total=1.0)
    with pytest.raises(InputError, match="no run of all stages"):
        seconds_of(tmp_path)
    (tmp_path / "timing.csv").write_text("a,b\n1,2\n")
    assert main([str(tmp_path), str(tmp_path)]) == 2
    assert "not a timing.csv" in capsys.readouterr().err


def test_a_wrong_use_is_told_by_its_options(capsys):
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 2 and "POINT_DIR" in capsys.readouterr().err
