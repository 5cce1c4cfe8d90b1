"""Nothing in the package writes a file but through `results.write_atomic` (read from the sources)."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1] / "bayes_dea"
FILES = sorted(ROOT.rglob("*.py"))
#: methods and functions that write a file given a path or a file
WRITERS = {"write_text", "write_bytes", "savefig", "to_netcdf", "to_csv", "to_parquet", "to_json", "savemat", "save",
           "savez", "savez_compressed", "savetxt", "write_csv", "write_table", "dump", "replace", "rename"}
#: where `replace` and `rename` mean files
RENAMERS = {"os", "shutil"}


def parents(tree):
    return {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}


def name_of(call):
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def owner_of(call):
    value = call.func.value if isinstance(call.func, ast.Attribute) else None
    return value.id if isinstance(value, ast.Name) else ""


def writes(call):
    """Whether a call writes to the disk, as far as its name and arguments say."""
    name = name_of(call)
    if name == "open":
        modes = [a.value for a in [*call.args, *(k.value for k in call.keywords if k.arg == "mode")]
                 if isinstance(a, ast.Constant) and isinstance(a.value, str)]
        return any(set(m) <= set("rwaxbt+") and set(m) & set("wax+") for m in modes)
    if name in ("replace", "rename"):
        return owner_of(call) in RENAMERS
    if name in ("save", "dump"):
        return owner_of(call) in ("np", "numpy", "json", "tomli_w", "pickle", "yaml")
    if name in ("write_text", "write_bytes"):  # our own functions of these names are the atomic ones
        return isinstance(call.func, ast.Attribute) and owner_of(call) != "results"
    return name in WRITERS and isinstance(call.func, ast.Attribute)  # not a function of the house


def into_memory(call, function):
    """Whether the first or second argument is a buffer that the same function made."""
    buffers = {t.id for node in ast.walk(function) if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
               and name_of(node.value) in ("BytesIO", "StringIO") for t in node.targets if isinstance(t, ast.Name)}
    return any(isinstance(a, ast.Name) and a.id in buffers for a in call.args[:2])


def stray(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    up = parents(tree)
    handed_over = {a.id for node in ast.walk(tree) if isinstance(node, ast.Call) and name_of(node) == "write_atomic"
                   for a in node.args if isinstance(a, ast.Name)}
    found = []
    for call in (n for n in ast.walk(tree) if isinstance(n, ast.Call) and writes(n)):
        node, function, excused = call, tree, False
        while node in up:
            node = up[node]
            if isinstance(node, ast.Call) and name_of(node) == "write_atomic":
                excused = True
            if isinstance(node, (ast.FunctionDef, ast.Lambda)):
                function = node if function is tree else function
                excused = excused or getattr(node, "name", "") in handed_over
        if not excused and not into_memory(call, function):
            found.append(f"{path.relative_to(ROOT.parent)}:{call.lineno}: {ast.unparse(call)[:80]}")
    return found


#: the atomic writer itself; and a folder of files that were written atomically, moved into place
#: or, for a device, a link to its port
ALLOWED = {"results.py", "bench/campaign_writer.py", "bench/device/serve.py"}
#: a journal is append-only: what is in it was whole before the next line came
JOURNALS = {"live/journal.py"}


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_stray_writes(path):
    found = stray(path)
    if str(path.relative_to(ROOT)) in JOURNALS:
        assert not any("write_text" in text or "'wb'" in text or "'w'" in text for text in found), found
    elif str(path.relative_to(ROOT)) in ALLOWED:
        assert all("os.replace" in text or "results.py" in text for text in found), found
    else:
        assert found == [], "write through bayes_dea.results: write_atomic, write_text, write_bytes or write_json"


def test_the_search_finds_what_it_should(tmp_path, monkeypatch):
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path / "package")
    (tmp_path / "package").mkdir()
    file = tmp_path / "package" / "a.py"
    bad = ["open(p, 'w')", "p.open('wb')", "p.open(mode='a')", "p.write_text('x')", "figure.savefig(p)",
           "np.savez(p, a=1)", "json.dump(x, f)", "data.to_netcdf(p)", "os.replace(a, b)", "io.savemat(p, {})"]
    good = ["open(p)", "p.open('rb')", "text.replace('a', 'w')", "result.save(out)", "write_text(p, 'x')",
            "write_atomic(p, lambda q: q.write_text('x'))"]
    file.write_text("\n".join([*bad, *good]) + "\ndef f(q):\n    q.write_bytes(b'')\nwrite_atomic(p, f)\n"
                    "def g():\n    buffer = io.BytesIO()\n    figure.savefig(buffer)\n", encoding="utf-8")
    assert [int(text.split(":")[1]) for text in stray(file)] == list(range(1, len(bad) + 1))
