from steelyard.robot.file.toml_edits import comment


def test_a_long_comment_keeps_its_indentation() -> None:
    first, *others = comment("word " * 40, "  # ").splitlines()
    assert first.startswith("  # word") and all(o.startswith("  #   word") for o in others)
    assert all(line.startswith("#   ") for line in comment("word " * 40, "# * ").splitlines()[1:])
