"""Write `result.schema.json`, the JSON Schema of result.json, from the classes of a result; run it when one of them changes."""

import json
from pathlib import Path

from looping_pendulum.compare import result

FILE = Path(result.__file__).with_name("result.schema.json")


def text() -> str:
    """Return the text of the file."""
    return json.dumps(result.ComparisonResult.json_schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
