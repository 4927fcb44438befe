"""Commit of a checkout, whichever way it stands at it."""

from pathlib import Path

import pytest

from gateway.diagnosis.revision import commit_of_checkout

COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.mark.parametrize("way", ["detached", "branch", "packed", "worktree", "none"])
def test_commit_is_read_from_the_checkout(tmp_path: Path, way: str) -> None:
    root, git = tmp_path / "tree", tmp_path / "tree" / ".git"
    repository = tmp_path / "main" / ".git" if way == "worktree" else git
    (repository / "refs" / "heads").mkdir(parents=True)
    root.mkdir(exist_ok=True)
    branch = repository / "refs" / "heads" / "topic"
    if way != "packed":
        branch.write_text(f"{COMMIT}\n")
    else:
        (repository / "packed-refs").write_text(f"# pack-refs with: peeled\n{COMMIT} refs/heads/topic\n")
    head = f"{COMMIT}\n" if way == "detached" else "ref: refs/heads/topic\n"
    if way == "worktree":
        worktree = repository / "worktrees" / "tree"
        worktree.mkdir(parents=True)
        (worktree / "commondir").write_text("../..\n")
        (worktree / "HEAD").write_text(head)
        git.write_text(f"gitdir: {worktree}\n")
    elif way != "none":
        (git / "HEAD").write_text(head)
    assert commit_of_checkout(root) == ("" if way == "none" else COMMIT)
