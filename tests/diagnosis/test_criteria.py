"""Thresholds of the inference: every one has its reason."""

from gateway.diagnosis import criteria
from tools.docs_site.threshold_pages import thresholds, thresholds_markdown


def test_reference_lists_every_threshold_with_its_reason() -> None:
    listed = list(thresholds())
    assert {name for name, _, _ in listed} == {name for name in vars(criteria) if name.isupper()}
    assert len(listed) >= 15
    assert [name for name, _, reason in listed if len(reason) <= 15] == []
    page = thresholds_markdown()
    assert f"| `NAMED` | {criteria.NAMED:g} | Probability from which an effect is identified" in page
    assert all(f"| `{name}` |" in page for name, _, _ in listed)


def test_names_are_rarely_wrong() -> None:
    assert criteria.SUPPORTED < criteria.LISTED < 0.5 < criteria.NAMED < 1.0
    assert criteria.PRIOR_ODDS < 0.1
