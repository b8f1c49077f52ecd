"""The JSON Schema of a config, for editors and for `strainsight schema`."""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from strainsight.config.bench.bearing import BearingConfig
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.placement import PlacementConfig
from strainsight.config.suite import SuiteConfig

AnyConfig = Annotated[PlacementConfig | BenchConfig | BearingConfig | SuiteConfig, Field(discriminator="kind")]


def config_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a config of any kind."""
    adapter: TypeAdapter[Any] = TypeAdapter(AnyConfig)
    schema = adapter.json_schema(by_alias=True)
    del schema["discriminator"]  # OpenAPI's, which the draft does not know; `kind` is a constant in each
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "strainsight config",
        "description": "One of the kinds of config, distinguished by `kind`.",
        **schema,
    }


def schema_text() -> str:
    """The schema as the text that docs/config.schema.json holds."""
    return json.dumps(config_schema(), indent=2, ensure_ascii=False) + "\n"
