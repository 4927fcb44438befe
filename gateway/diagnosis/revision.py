"""Commit of the code that runs, where it is a checkout or was installed from one."""

import json
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

_HEAD = "ref: "


@cache
def commit() -> str:
    """Return the commit in hexadecimal digits, empty where it is not known.

    Of a checkout it is the one that it stands at, whatever was changed in its files since.
    """
    return commit_of_checkout(Path(__file__).parents[2]) or _of_installation()


def commit_of_checkout(root: Path) -> str:
    """Return the commit that a checkout stands at, empty if the folder is none."""
    try:
        git = root / ".git"
        if git.is_file():
            # A worktree: its own HEAD, the branches of the repository.
            git = (root / git.read_text(encoding="utf-8").removeprefix("gitdir: ").strip()).resolve()
        head = (git / "HEAD").read_text(encoding="utf-8").strip()
        if not head.startswith(_HEAD):
            return head
        common = git / "commondir"
        common_dir = (git / common.read_text(encoding="utf-8").strip()).resolve() if common.is_file() else git
        branch = head.removeprefix(_HEAD)
        if (common_dir / branch).is_file():
            return (common_dir / branch).read_text(encoding="utf-8").strip()
        packed = (common_dir / "packed-refs").read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return ""
    return next((line.split()[0] for line in packed if line.endswith(f" {branch}")), "")


def _of_installation() -> str:
    """Return the commit that pip noted when it installed from a repository."""
    try:
        noted = json.loads(distribution("treadlink").read_text("direct_url.json") or "{}")
        return str(noted.get("vcs_info", {}).get("commit_id", ""))
    except (PackageNotFoundError, OSError, ValueError, AttributeError):
        return ""
