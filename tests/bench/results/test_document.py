"""The tables of the documents, and the figures that are kept for them."""

import dataclasses
import re
from pathlib import Path

import msgspec
import pytest

from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import select
from hsslam_bench.results.document import BEGIN, END, fill_document, with_tables
from hsslam_bench.results.newest_rows import keep, read_for_documents
from hsslam_bench.results.report import read_report, report, write_report
from hsslam_bench.runs.session import Session
from hsslam_node.errors import UserError
from tests.bench.result_files import row_of, stored
from tests.repository import ROOT


def test_every_row_stands_in_the_results():
    text = (ROOT / "docs/results.md").read_text()
    table = text.partition(BEGIN)[2].partition(END)[0]
    assert [line.split("`")[1] for line in table.splitlines() if line.startswith("| `")] == [
        check.name for check in select(catalogue(), [])
    ]


def test_tables_of_the_performance_document_name_rows_that_are_there():
    path = ROOT / "docs/performance.md"
    filled = with_tables(path.read_text(), path.name, [])
    for name in ("budget", "viewer:room:latency", "memory", "growth:room:time", "gpu:kernels"):
        assert f"| `{name}` |" in filled


def test_a_table_of_columns_tells_what_its_rows_measure_and_the_unit(tmp_path: Path):
    row = dataclasses.replace(row_of("growth:room:time"), values={"growth-4m": {"all": 53.1}})
    found = read_for_documents(stored(tmp_path / "1.json", row))
    filled = with_tables(f"<!-- bench:columns growth:room:time -->\n{END}\n", "page.md", [found])
    assert ", ms of core time a frame |  |\n|  | all | 53.1 |\n" in filled


@pytest.mark.parametrize("name", ["results.md", "performance.md", "batch.md"])
def test_tables_of_the_documents_show_the_figures_that_are_kept(name: str):
    docs = ROOT / "docs"
    reports = [read_for_documents(path) for path in sorted((docs / "figures").glob("*.json"))]
    text = (docs / name).read_text()
    assert with_tables(text, name, reports) == text


def test_only_the_newest_figure_of_a_row_is_kept(tmp_path: Path):
    first = stored(tmp_path / "1.json", row_of("ate:house", "0.70 cm"), row_of("memory", "3 GB"))
    gone = dataclasses.replace(row_of("budget"), name="of:old")
    second = stored(tmp_path / "2.json", row_of("ate:house", "0.41 cm"), gone)
    earlier = msgspec.structs.replace(read_report(first), time="2026-01-02T03:04:05Z")
    write_report(first, earlier)
    folder = tmp_path / "figures"
    assert [path.name for path in keep(folder, [first])] == ["2026-01-02T030405Z.json"]
    old, new = map(read_report, keep(folder, [second]))
    assert [(row.name, row.measured) for row in old.rows] == [("memory", "3 GB")]
    assert [(row.name, row.measured) for row in new.rows] == [("ate:house", "0.41 cm")]
    renewed = msgspec.structs.replace(earlier, time="2027-01-02T03:04:05Z")
    write_report(first, renewed)
    assert [path.name for path in keep(folder, [first])] == ["2027-01-02T030405Z.json"]
    assert keep(folder, [second]) == sorted(folder.iterdir())  # older than what is there


def test_results_that_began_in_the_same_second_are_all_kept(tmp_path: Path):
    found = [
        stored(tmp_path / f"{name}.json", row_of(name, "measured")) for name in ("memory", "budget")
    ]
    for path in found:
        write_report(path, msgspec.structs.replace(read_report(path), time="2026-01-02T03:04:05Z"))
    kept = keep(tmp_path / "figures", found)
    assert [path.name for path in kept] == ["2026-01-02T030405Z-2.json", "2026-01-02T030405Z.json"]
    names = {row.name for path in kept for row in read_report(path).rows}
    assert names == {"memory", "budget"}
    assert keep(tmp_path / "figures", []) == kept


def test_document_holds_what_was_measured_last(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_text(f"before\n{BEGIN}\nan earlier table\n{END}\nafter\n")
    first = stored(tmp_path / "1.json", row_of("ate:house", "0.70 cm", "NOT MET"), row_of("memory"))
    second = stored(
        tmp_path / "2.json",
        row_of("ate:house", "0.41 cm", "ok"),
        row_of("memory", "nothing on disk", "skipped"),
        row_of("gpu:paper", "no device here", "not measured"),
    )
    fill_document(document, [first])
    assert "0.70 cm | **NOT MET** |" in document.read_text()
    fill_document(document, [first, second])
    text = document.read_text()
    assert text.startswith(f"before\n{BEGIN}\n| name")
    assert text.endswith(f"\n{END}\nafter\n")
    assert "an earlier table" not in text
    assert "| 0.41 cm | ok |" in text
    assert "0.70" not in text
    assert "nothing on disk" not in text
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(rows) == len(select(catalogue(), []))
    assert sum("| not measured" in row for row in rows) == len(rows) - 2
    assert "| not measured: no device here |" in text
    again = text
    fill_document(document, [first, second])
    assert document.read_text() == again


def test_line_ends_stay_and_other_text_is_refused(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_bytes(f"before\n{BEGIN}\nold\n{END}\n".replace("\n", "\r\n").encode())
    found = stored(tmp_path / "1.json", row_of("memory"))
    fill_document(document, [found])
    text = document.read_bytes()
    assert b"| name" in text and text.count(b"\n") == text.count(b"\r\n") > 3
    document.write_bytes(b"\xff\xfe" + text)
    with pytest.raises(UserError, match=r"--docs .*results\.md: is not UTF-8: expected a document"):
        fill_document(document, [found])
    document.write_text(f"{BEGIN}\nold\nwords\n{BEGIN}\nold\n{END}\n")  # the first has no end
    before = document.read_text()
    with pytest.raises(UserError, match=r"results\.md: .*: expected .* before the next marker"):
        fill_document(document, [found])
    assert document.read_text() == before
    document.write_text(f"<!-- bench:rows nope -->\nold\n{END}\n")
    with pytest.raises(UserError, match=r"results\.md: <!-- bench:rows nope -->: .*nope"):
        fill_document(document, [found])


def test_a_row_measured_against_another_bound_is_not_in_the_document(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_text(f"{BEGIN}\n{END}\n")
    row = dataclasses.replace(row_of("memory", "9 GB"), bound="10 GB")
    fill_document(document, [stored(tmp_path / "1.json", row)])
    assert "9 GB" not in document.read_text()


def test_a_row_of_another_version_of_its_check_is_neither_kept_nor_in_the_document(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_text(f"{BEGIN}\n{END}\n")
    path = stored(tmp_path / "1.json", row_of("mesh:house:accuracy", "0.31 cm"), row_of("memory"))
    fill_document(document, [path])
    assert "0.31 cm" in document.read_text()
    path.write_text(re.sub(r',\s*"version": 2', "", path.read_text()))  # as before versions
    fill_document(document, [path])
    assert "0.31 cm" not in document.read_text()
    (kept,) = keep(tmp_path / "figures", [path])
    assert [row.name for row in read_report(kept).rows] == ["memory"]


def test_document_holds_chosen_rows_and_their_values_by_run(tmp_path: Path):
    document = tmp_path / "performance.md"
    head, columns = "<!-- bench:rows budget memory -->", "<!-- bench:columns budget -->"
    document.write_text(f"one\n{head}\n{END}\ntwo\n{columns}\n{END}\nthree\n")
    used = {"viewer-room": {"tracker": 9.51, "saver": 0.01}, "viewer-kitchen": {"tracker": 8.0}}
    row = dataclasses.replace(row_of("budget", "17.5"), values=used)
    fill_document(document, [stored(tmp_path / "1.json", row)])
    first, _, second = document.read_text().partition("two\n")
    assert [line.split("`")[1] for line in first.splitlines() if line.startswith("| `")] == [
        "budget",
        "memory",
    ]
    assert "| row |  | viewer-room | viewer-kitchen |" in second
    assert "\n|  | tracker | 9.5 | 8.0 |\n" in second
    assert "saver" not in second
    assert second.endswith(f"{END}\nthree\n")
    document.write_text(f"<!-- bench:rows bugdet -->\n{END}\n")
    with pytest.raises(UserError, match="budget"):
        fill_document(document, [])


def test_a_document_counts_the_bounds_that_are_met_and_names_the_others(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_text(f"<!-- bench:summary -->\nold\n{END}\n")
    first = row_of("ate:house", "0.41 cm", "ok"), row_of("ate:kitchen", "9 cm", "NOT MET")
    fill_document(document, [stored(tmp_path / "1.json", *first)])
    text = document.read_text()
    bounded = sum(bool(check.bound) for check in catalogue())
    assert f"\n1 of {bounded} bounds are met.\n" in text
    assert "\nNot met, 1: `ate:kitchen`.\n" in text
    (unmeasured,) = re.findall(rf"^Not measured, {bounded - 2}: (.*)$", text, re.M)
    assert "`ate:livingroom`" in unmeasured and "`ate:house`" not in unmeasured


def test_document_takes_no_try_outs(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_text(f"{BEGIN}\n{END}\n")
    quick = tmp_path / "quick.json"
    write_report(quick, report(Session(tmp_path, tmp_path, quick=True)))
    with pytest.raises(UserError, match="--quick"):
        fill_document(document, [quick])
    with pytest.raises(UserError, match=r"missing\.json"):
        fill_document(document, [tmp_path / "missing.json"])
    document.write_text("no markers")
    with pytest.raises(UserError, match="bench:begin"):
        fill_document(document, [stored(tmp_path / "1.json")])
