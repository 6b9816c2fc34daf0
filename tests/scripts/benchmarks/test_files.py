from scripts.benchmarks import files


def test_the_file_that_is_read_has_the_lines_that_are_promised() -> None:
    assert "\n".join(files.corridor_lines()).count("\n") == files.LINES + 4
    (row,) = files.pomdp_file(1)
    assert row.unit == "core-ms"
    assert row.median > 0.0
