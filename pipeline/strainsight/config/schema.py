"""The JSON Schema of a config, for editors and for `strainsight schema`."""

from __future__ import annotations

import json
from typing import Any

from strainsight.config.placement import PlacementConfig


def config_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of `kind: placement`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **PlacementConfig.model_json_schema(by_alias=True),
    }


def schema_text() -> str:
    """The schema as the text that docs/config.schema.json holds."""
    return json.dumps(config_schema(), indent=2, ensure_ascii=False) + "\n"
