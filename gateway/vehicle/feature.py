"""Declaration of the feature."""

from typing import Final

from gateway.feature import Feature

FEATURE: Final = Feature()
