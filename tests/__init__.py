"""Tests of the project. A package of its own: one of the same name that a dependency installs does not hide it."""
