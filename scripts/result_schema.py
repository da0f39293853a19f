"""Write the JSON Schemas of result.json and verdict.json from the classes of the results; run it when one of them changes."""

import json
from pathlib import Path

from looping_pendulum.compare import result
from looping_pendulum.discrepancy import result as verdict

SCHEMAS = {
    Path(result.__file__).with_name("result.schema.json"): result.ComparisonResult.json_schema,
    Path(verdict.__file__).with_name("verdict.schema.json"): verdict.json_schema,
}


def text(file: Path) -> str:
    """Return the text of one of the files."""
    return json.dumps(SCHEMAS[file](), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for file in SCHEMAS:
        file.write_text(text(file), encoding="utf-8")
