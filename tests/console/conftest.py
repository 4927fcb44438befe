"""Results as views see them."""

from tests.testkit.made_results import made  # noqa: F401 - a fixture
