from pathlib import Path

from common.system.paths import exists, expanded, is_file


def test_a_tilde_is_the_home_folder_and_a_stranger_stays_as_it_is(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert expanded("~/maps") == tmp_path / "maps"
    assert expanded("~nobody-of-that-name/maps") == Path("~nobody-of-that-name/maps")


def test_a_name_that_no_system_takes_is_not_there(tmp_path):
    (tmp_path / "here").touch()
    assert exists(tmp_path / "here") and is_file(tmp_path / "here")
    assert not exists(tmp_path / ("x" * 300)) and not is_file(tmp_path / ("x" * 300))
