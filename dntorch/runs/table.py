"""One table of many runs, in formats that pandas opens."""

import csv
import io
import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dntorch.files import write_atomically


def row(results: dict[str, Any]) -> dict[str, Any]:
    """The results of a run as one row: what it was asked for, then what it came to."""
    came_to = {k: v for k, v in results.items() if k not in ("config", "rewards")}
    return results["config"] | came_to | {"rewards": len(results["rewards"])}


def write(folder: Path, results: list[dict[str, Any]]) -> list[Path]:
    """Write ``table.csv``, ``table.jsonl`` and, where pyarrow is, ``table.parquet``.

    ``rewards`` is their number; the value matrix is a list, in the CSV as JSON.
    """
    rows = [row(one) for one in results]
    lines = "".join(json.dumps(one) + "\n" for one in rows)
    contents = {"table.csv": _csv(rows).encode(), "table.jsonl": lines.encode()}
    if rows and find_spec("pyarrow"):
        contents["table.parquet"] = _parquet(rows)
    for name, content in contents.items():
        write_atomically(folder / name, lambda file, content=content: file.write(content))
    return [folder / name for name in contents]


def _csv(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    for one in rows:
        nested = {k: json.dumps(v) for k, v in one.items() if isinstance(v, (list, dict))}
        writer.writerow(one | nested)
    return text.getvalue()


def _parquet(rows: list[dict[str, Any]]) -> bytes:
    import pyarrow
    from pyarrow import parquet

    sink = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.Table.from_pylist(rows), sink)
    return sink.getvalue().to_pybytes()
