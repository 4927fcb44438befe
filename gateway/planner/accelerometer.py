"""Accelerometers as their data sheets describe them, and the list that is shipped."""

from importlib.resources import files
from typing import Final

from pydantic import Field

from gateway.core.config.validation import Section, above, parse_document, within
from gateway.planner.link_load import PowerModel

SHIPPED: Final = "accelerometers.toml"


class Accelerometer(Section):
    """`[[sensor]]`: one part at one setting. What its data sheet does not tell stays out."""

    name: str = Field(min_length=1, max_length=60, description="part and setting")
    range_g: float = Field(ge=1, le=10_000, description="range in g")
    rate_hz: float | None = above(None, 0, 1e6, "sampling rate in Hz; left out for an analog part")
    rate_error_percent: float = within(0.0, -5, 5, "error of the sampling rate in percent")
    bandwidth_hz: float | None = within(None, 10, 1e6, "-3 dB bandwidth in Hz")
    noise_mg_rthz: float | None = within(None, 0, 1000, "noise density in mg/sqrt(Hz)")
    resolution_mg: float | None = above(None, 0, 1e5, "step of the output in mg")
    highpass_hz: float | None = above(None, 0, 100, "corner of an AC-coupled part in Hz")
    zero_g_offset_g: float = within(0.0, -1000, 1000, "error of the zero in g")
    gain_error_percent: float = within(0.0, -50, 50, "error of the sensitivity in percent")
    cross_axis_percent: float = within(0.0, -20, 20, "share of each other axis in the output in percent")
    axes: int | None = within(None, 1, 3, "number of axes")
    interface: str = Field(default="", description="how it is read")
    survival_g: float | None = Field(default=None, gt=0, description="shock that it survives in g")
    current_ma: float | None = Field(default=None, gt=0, description="supply current while it measures, in mA")
    source: str = Field(default="", description="document and its number")

    def missing(self) -> tuple[str, ...]:
        """Return the values without which no errors can be planned."""
        statements = {
            "rate and band": self.rate_hz is not None or self.bandwidth_hz is not None,
            "noise": self.noise_mg_rthz is not None,
        }
        return tuple(name for name, is_stated in statements.items() if not is_stated)


class AccelerometerList(Section):
    """A file of accelerometers."""

    sensor: tuple[Accelerometer, ...] = Field(strict=False, min_length=1, description="the accelerometers")
    power: PowerModel | None = Field(default=None, description="power model of the wheel's electronics")


def parse_accelerometers(text: str, origin: str) -> AccelerometerList:
    """Return the accelerometers of a TOML document, with its power model.

    Raises:
        ConfigError: it has faults; the message names every one.
    """
    return parse_document(AccelerometerList, text, origin)


def shipped_accelerometers() -> AccelerometerList:
    """Return the list that is shipped."""
    return parse_accelerometers((files("gateway.planner") / SHIPPED).read_text("utf-8"), SHIPPED)
