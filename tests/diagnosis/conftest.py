"""Pages of diagnoses, drawn once for all tests."""

import pytest

from tests.testkit.diagnosis_data import nasty, ordinary


@pytest.fixture(scope="session")
def page_text() -> str:
    """Page of an ordinary diagnosis of two groups."""
    from gateway.diagnosis.views.html import diagnosis_html

    return diagnosis_html(ordinary(2))


@pytest.fixture(scope="session")
def nasty_text() -> str:
    """Page of a diagnosis with hostile strings."""
    from gateway.diagnosis.views.html import diagnosis_html

    return diagnosis_html(nasty())
