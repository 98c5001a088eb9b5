"""How an ended engine is spoken of, and how much memory it may use."""

from handtrack_app.process import child
from handtrack_app.process.child import GB


def test_c40_a_container_has_what_its_groups_allow(tmp_path, monkeypatch):
    own, groups = tmp_path / "cgroup", tmp_path / "groups"
    monkeypatch.setattr(child, "_OWN_GROUPS", own)
    monkeypatch.setattr(child, "_CONTROL_GROUPS", groups)
    physical = child.machine_memory()
    (groups / "a/b").mkdir(parents=True)
    (groups / "memory/c").mkdir(parents=True)
    (groups / "a/b/memory.max").write_text("max\n")
    (groups / "a/memory.max").write_text(f"{2 * GB}\n")
    (groups / "memory/c/memory.limit_in_bytes").write_text(f"{GB}\n")
    own.write_text("0::/a/b\n")
    assert child.machine_memory() == min(physical, 2 * GB)
    own.write_text("0::/a/b\n4:cpu,memory:/c\n3:pids:/d\n")
    assert child.machine_memory() == min(physical, GB)
    assert child.memory_limit() == GB, "less would be too little to begin with"
    own.write_text("0::/elsewhere\n")
    assert child.machine_memory() == physical
