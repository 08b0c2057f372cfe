from hsslam_services.log.parts import next_part, parts, remove_oldest, removed_before


def test_parts_are_in_order(tmp_path):
    for name in ("run.10.mcap", "run.2.mcap", "run.mcap", "other.mcap", "run.damaged.mcap"):
        (tmp_path / name).touch()
    assert [part.name for part in parts(tmp_path)] == ["run.mcap", "run.2.mcap", "run.10.mcap"]
    assert next_part(tmp_path).name == "run.11.mcap"


def test_the_oldest_parts_go_and_never_the_newest(tmp_path):
    for name in ("run.10.mcap", "run.2.mcap", "run.mcap"):
        (tmp_path / name).write_bytes(bytes(1000))
    assert remove_oldest(tmp_path, 3000) == []
    assert [path.name for path in remove_oldest(tmp_path, 2999)] == ["run.mcap"]
    assert [path.name for path in remove_oldest(tmp_path, 1)] == ["run.2.mcap"]
    assert [path.name for path in parts(tmp_path)] == ["run.10.mcap"]


def test_the_file_for_rerun_counts_and_goes_with_its_part(tmp_path):
    for name in ("run.mcap", "run.rrd", "run.1.mcap", "run.1.rrd"):
        (tmp_path / name).write_bytes(bytes(1000))
    assert remove_oldest(tmp_path, 4000) == []
    assert [path.name for path in remove_oldest(tmp_path, 3999)] == ["run.mcap"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.1.mcap", "run.1.rrd"]


def test_numbers_say_how_many_parts_were_removed(tmp_path):
    assert removed_before(parts(tmp_path)) == 0
    for number in range(3, 6):
        (tmp_path / f"run.{number}.mcap").touch()
    assert removed_before(parts(tmp_path)) == 3
