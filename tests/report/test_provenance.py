from dpsearch.report.provenance import command, machine


def test_the_command_can_be_pasted_into_a_shell() -> None:
    assert command("scripts/x.py", ["--out", "a b"]) == "python scripts/x.py --out 'a b'"


def test_the_machine_is_named_in_one_line() -> None:
    assert machine().endswith(" cores")
    assert "\n" not in machine()
