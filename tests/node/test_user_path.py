"""Paths with `~`: a user without a home is one line."""

import os
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import cache_root
from hsslam_node.sources.download.data_folder import data_folder
from hsslam_node.user_path import user_path

_NOBODY = 123_456_789  # no user has this id


def test_a_home_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HOME", "/home/me")
    assert user_path("~/desk") == Path("/home/me/desk")
    with pytest.raises(UserError, match="~nosuchuser/x: ~nosuchuser has no home folder"):
        user_path("~nosuchuser/x")
    monkeypatch.delenv("HOME")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(os, "getuid", lambda: _NOBODY)
    with pytest.raises(UserError, match=r"^~/.cache/hsslam: .* or XDG_CACHE_HOME$"):
        cache_root()
    monkeypatch.setenv("XDG_CACHE_HOME", "/cache")
    assert cache_root() == Path("/cache/hsslam")


def test_folders_in_the_environment_may_begin_with_a_tilde_or_be_relative(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """As in a file of systemd, where no shell replaces the tilde."""
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.chdir(tmp_path)
    for name, folder in (("~/x", Path("/home/me/x")), ("x", tmp_path / "x")):
        monkeypatch.setenv("XDG_CACHE_HOME", name)
        monkeypatch.setenv("HSSLAM_DATA", name)
        assert (cache_root(), data_folder()) == (folder / "hsslam", folder)
