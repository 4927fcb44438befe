import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.toml_writer import toml_text

SCALARS = (
    st.text() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False) | st.booleans()
)
VALUES = SCALARS | st.lists(SCALARS, max_size=3)
TABLES = st.dictionaries(st.text(), VALUES, min_size=1, max_size=3)
NESTED = st.recursive(
    TABLES,
    lambda inner: st.dictionaries(st.text(), VALUES | inner | st.lists(inner, min_size=1, max_size=3), min_size=1),
    max_leaves=8,
)


@given(NESTED)
def test_written_values_read_back(document: dict[str, Any]) -> None:
    assert tomllib.loads(toml_text(document)) == document


def test_empty_tables_are_left_out() -> None:
    assert tomllib.loads(toml_text({"a": 1, "b": {}, "c": {"d": {}}})) == {"a": 1}


def test_values_without_toml_form_are_rejected() -> None:
    with pytest.raises(TypeError, match="NoneType"):
        toml_text({"a": None})
