import sys

from actors import launching
from common.system.kernel_folders import cache_folder


def test_kernels_are_compiled_before_the_first_start_and_not_before_the_next(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    cache_folder.cache_clear()
    cache_folder("actors").mkdir(parents=True)
    starts = tmp_path / "starts"
    program = f"import sys; print(sys.argv[1:], file=open({str(starts)!r}, 'a'))"
    # Compiling itself takes minutes.
    monkeypatch.setattr(launching, "python_module", lambda *words: [sys.executable, "-c", program, *words])
    try:
        for network in ("{}", "{}", '{"width": 128}', "{}"):
            launching.compile_kernels(network)
    finally:
        cache_folder.cache_clear()
    assert starts.read_text().splitlines() == ["['actors.warmup', '{}']", "['actors.warmup', '{\"width\": 128}']"]
