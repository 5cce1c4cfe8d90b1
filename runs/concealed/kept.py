"""The rows of a study as they are kept beside its scores: small, and enough to make the scores again or to add to them.

    python runs/concealed/judge.py reports/concealed/rows.jsonl.gz FURTHER --none reports/concealed/none.jsonl.gz
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from scores import Row

_AS_THEY_ARE = (
    "seed", "kind", "code", "truth", "concealed", "effects", "sizes", "verdict", "confidence", "raw", "set", "lead",
    "beside", "proof", "seconds", "processor_s", "p_value", "adequacy", "model", "mechanical", "error",
)  # fmt: skip


@cache
def code_digest() -> str:
    """Digest of the package that diagnoses: rows of different ones are different versions."""
    import bayes_dea

    root = Path(bayes_dea.__file__).parent
    digest = hashlib.sha256()
    for file in sorted(root.rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()[:12]


def slim(row: Row) -> Row:
    """A row without what no score needs: of the hypotheses the verdict's interval alone."""
    out = {k: rounded(row[k]) for k in _AS_THEY_ARE if row.get(k) is not None}
    named = [h for h in row.get("hypotheses", []) if h["name"] == row.get("verdict")]
    out["hypotheses"] = [
        {
            "name": h["name"],
            "parameters": {n: {k: rounded(f[k]) for k in ("q05", "q95")} for n, f in h["parameters"].items()},
        }
        for h in named
    ]
    return out


def rounded(value: Any) -> Any:
    """Numbers to six digits, in whatever they stand."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    return [rounded(v) for v in value] if isinstance(value, list) else value


def packed(rows: Iterable[Row]) -> bytes:
    """Slim rows, a line each, packed; the same rows give the same bytes."""
    text = "".join(json.dumps(slim(r), separators=(",", ":")) + "\n" for r in rows)
    out = io.BytesIO()
    with gzip.GzipFile(fileobj=out, mode="wb", mtime=0) as file:
        file.write(text.encode())
    return out.getvalue()
