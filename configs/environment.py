"""Environment: where temperature and humidity are read."""

from __future__ import annotations

import re
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, Strict, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from .settings import FolderPath, Positive, Settings, Text, at_key

__all__ = ["Environment"]

_HTTP = r"https?://[^\s/]+(/\S*)?"
_MQTT = r"mqtts?://[^\s/@]+(:\d+)?/\S+"


def _url(pattern: str, example: str) -> Any:
    def check(value: Any) -> Any:
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise ValueError(f"must be an address such as {example}, not {value!r}")
        return value

    return BeforeValidator(check)


HttpUrl = Annotated[
    str, _url(_HTTP, "http://sensor.local/now.json"), WithJsonSchema({"type": "string", "pattern": f"^{_HTTP}$"})
]
MqttUrl = Annotated[
    str, _url(_MQTT, "mqtt://broker.local:1883/site/air"), WithJsonSchema({"type": "string", "pattern": f"^{_MQTT}$"})
]


class Environment(Settings):
    """Temperature and humidity from one of `csv`, `http` and `mqtt`: kept with each scan, and regressed out."""

    csv: FolderPath | None = Field(
        default=None, description="A logger's file, which may grow; its first line names the columns."
    )
    http: HttpUrl | None = Field(default=None, description="Address that answers with JSON; asked at each visit.")
    mqtt: MqttUrl | None = Field(
        default=None,
        description="mqtt://HOST:PORT/TOPIC with JSON or a plain number as message (extra `mqtt`). User and password "
        "come from MICRORELIEF_MQTT_USER and MICRORELIEF_MQTT_PASSWORD.",
    )
    time_column: Text = Field(
        default="time", description="Of `csv`: ISO 8601, in the site's zone where they name none."
    )
    temperature_c: Text | None = Field(
        default=None, description="Column, or field of the JSON (a.b for b in a), that holds the temperature, °C."
    )
    humidity_percent: Text | None = Field(
        default=None, description="Column, or field of the JSON, that holds the relative humidity, %."
    )
    temperature_sigma_c: Positive = Field(default=0.5, description="Standard uncertainty of the sensor, °C.")
    humidity_sigma_percent: Positive = Field(default=3.0, description="Standard uncertainty of the sensor, %.")
    max_lag_hours: Annotated[float, Strict(), Field(ge=0, le=24 * 30, allow_inf_nan=False)] = Field(
        default=0.0, description="Trends are corrected with the lag up to this that explains most."
    )
    max_age_minutes: Positive = Field(default=60.0, description="A reading farther from the scan than this is none.")
    timeout_s: Annotated[float, Strict(), Field(gt=0, le=60, allow_inf_nan=False)] = Field(
        default=2.0, description="How long a visit waits for an answer."
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        given = [name for name in ("csv", "http", "mqtt") if getattr(self, name) is not None]
        if len(given) != 1:
            told = " and ".join(given) if given else "none"
            raise PydanticCustomError(
                "one_source", "needs exactly one of csv, http and mqtt, not {told}", {"told": told}
            )
        if self.temperature_c is None and self.humidity_percent is None:
            raise PydanticCustomError("no_quantity", "needs temperature_c, humidity_percent or both")
        if self.csv is None and "time_column" in self.model_fields_set:
            raise at_key(("time_column",), "has no meaning without csv")
        return self

    @property
    def fields(self) -> dict[str, str]:
        """Column or field of each quantity, by the name under which it is kept."""
        pairs = (("temperature", self.temperature_c), ("humidity", self.humidity_percent))
        return {name: where for name, where in pairs if where is not None}

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard uncertainty of each quantity."""
        known = {"temperature": self.temperature_sigma_c, "humidity": self.humidity_sigma_percent}
        return {name: known[name] for name in self.fields}
