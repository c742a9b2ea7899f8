"""Files written in one piece."""

from pathlib import Path

import pytest

from trussflow.blocks.framework.files import replaced


def test_the_new_file_appears_whole_and_alone(tmp_path: Path) -> None:
    file = tmp_path / "result.txt"
    file.write_text("old")
    with replaced(file) as partial:
        partial.write_text("new")
        assert file.read_text() == "old"
    assert file.read_text() == "new"
    assert list(tmp_path.iterdir()) == [file]


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    file = tmp_path / "result.txt"
    file.write_text("old")
    with pytest.raises(RuntimeError, match="half way"), replaced(file) as partial:  # noqa: PT012
        partial.write_text("ne")
        raise RuntimeError("half way")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]
