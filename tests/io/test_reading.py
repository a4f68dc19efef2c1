"""What a file that cannot be read is refused with."""

import pytest

from tactile_diffusers.io.reading import read_json, reading


def test_a_mark_before_utf8_is_no_damage(tmp_path):
    (tmp_path / "settings.json").write_text('{"name": "é"}', encoding="utf-8-sig")
    assert read_json(tmp_path / "settings.json", "JSON") == {"name": "é"}


def test_what_may_not_be_read_need_not_be_copied_again():
    with pytest.raises(ValueError, match="^a.h5 may not be read .*Permission denied.* Change its permissions.$"):
        with reading("a.h5", "a store"):
            raise PermissionError(13, "Permission denied")


def test_what_does_not_fit_into_memory_need_not_be_copied_again():
    with pytest.raises(ValueError) as refused, reading("a.npz", "an array"):
        raise MemoryError("Unable to allocate 7.28 TiB for an array")
    told = str(refused.value)
    assert told.startswith("a.npz cannot be read as an array: it does not fit into memory (Unable to allocate 7.28 TiB")
    assert "Free memory" in told and "its header claims too much" in told and "Copy it again" not in told
    with pytest.raises(ValueError, match="memory .full."), reading("a.npz", "an array"):
        raise MemoryError
