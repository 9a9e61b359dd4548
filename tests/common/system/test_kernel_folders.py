import pytest

from common.system.kernel_folders import cache_folder, forget_old_caches, is_prepared, note_prepared


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    cache_folder.cache_clear()
    yield tmp_path
    cache_folder.cache_clear()


def test_what_was_prepared_is_known_by_package_and_use():
    assert not is_prepared("actors", "width 64")
    forget_old_caches()
    note_prepared("actors", "width 64")
    assert is_prepared("actors", "width 64")
    assert not is_prepared("actors", "width 128")
    assert not is_prepared("learner", "width 64")


def test_another_kind_of_processor_prepares_its_own(monkeypatch):
    forget_old_caches()
    note_prepared("actors", "width 64")
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "another")
    assert not is_prepared("actors", "width 64")


def test_a_folder_of_the_users_own_may_hold_kernels_of_other_sources(tmp_path, monkeypatch):
    forget_old_caches()
    note_prepared("actors", "width 64")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "own"))
    assert not is_prepared("actors", "width 64")


def test_what_is_kept_in_a_folder_of_the_users_own_is_not_noted_elsewhere(tmp_path, monkeypatch):
    forget_old_caches()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "own"))
    note_prepared("actors", "width 64")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert not is_prepared("actors", "width 64")


@pytest.mark.parametrize("name", ["file", "x" * 300])
def test_a_place_that_takes_no_note_is_prepared_each_time(home, monkeypatch, name):
    (home / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / name))
    cache_folder.cache_clear()
    note_prepared("actors", "width 64")
    assert not is_prepared("actors", "width 64")
