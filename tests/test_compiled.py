"""Kept machine code is that of its sources."""

import os
import sys
from contextlib import redirect_stdout
from io import StringIO

import numba
import pytest

INNER = "from handtrack.compiled import compiled\n\n@compiled\ndef inner(x):\n    return x + {}\n"
OUTER = "from handtrack.compiled import compiled\nfrom inner import inner\n\n@compiled\ndef outer(x):\n    return 2 * inner(x)\n"
ASKED = "from outer import outer; print(outer(1), *outer.stats.cache_hits.values())"
BY_FILE = """from importlib.util import module_from_spec, spec_from_file_location
spec = spec_from_file_location("page", "inner.py")
spec.loader.exec_module(page := module_from_spec(spec))
print(page.inner(1))"""


def called(folder, cache, asked=ASKED):
    """Return what is printed where the folder's modules are imported anew."""
    for name in ("inner", "outer", "types_"):
        sys.modules.pop(name, None)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as said:
        patch.chdir(folder)
        patch.syspath_prepend(folder)
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.setattr(numba.config, "CACHE_DIR", str(cache))
        exec(asked, {})
    return said.getvalue().split()


def test_machine_code_is_made_anew_where_a_function_that_it_calls_changed_in_another_file(tmp_path):
    one, other, cache = tmp_path / "one", tmp_path / "other", tmp_path / "kept"
    for folder, added in ((one, 1), (other, 1)):
        folder.mkdir()
        (folder / "inner.py").write_text(INNER.format(added))
        (folder / "outer.py").write_text(OUTER)
    assert called(one, cache) == ["4"]
    assert called(other, cache) == ["4", "1"], (
        "the same sources in another place: nothing is compiled"
    )
    (other / "inner.py").write_text(INNER.format(2))
    assert called(other, cache) == ["6"]
    assert called(one, cache) == ["4", "1"], "both versions are kept"
    for file in (before := [*cache.glob("inner/*.nb?")]):
        os.utime(file, (0, 0))
    (one / "inner.py").write_text(INNER.format(3))
    assert called(one, cache) == ["8"]
    assert not any(file.exists() for file in before), "what was written long ago goes"


def test_a_function_of_a_module_that_is_loaded_by_its_file_is_called_again_and_again(tmp_path):
    (tmp_path / "inner.py").write_text(INNER.format(1))
    assert [called(tmp_path, tmp_path / "kept", BY_FILE) for _ in range(2)] == [["2"], ["2"]]


def test_code_for_a_type_that_this_version_calls_otherwise_is_made_anew(tmp_path):
    (tmp_path / "inner.py").write_text(
        INNER.format(1).replace("(x)", "(pair)").replace("return x", "return pair.x")
    )
    late = "inner.inner._cache.load_overload = lambda *_: None; "  # another version keeps its code while this one compiles
    for name, when in (("Pair", ""), ("Two", ""), ("Pair", late)):
        (tmp_path / "types_.py").write_text(
            f"from typing import NamedTuple\nclass {name}(NamedTuple):\n    x: int\n"
        )
        asked = f"import inner, types_; {when}print(inner.inner(types_.{name}(1)))"
        assert called(tmp_path, tmp_path / "kept", asked) == ["2"]
