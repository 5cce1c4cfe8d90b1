"""The house's rules: who may import whom (read from the sources, nothing is imported)."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1] / "bayes_dea"
FILES = sorted(ROOT.rglob("*.py"))


def module_of(path):
    parts = ("bayes_dea", *path.relative_to(ROOT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(p): p for p in FILES}


def _is_type_checking(node):
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)


def _nodes(body, deep):
    """Import statements of a body, with `deep` also those inside functions; what is there for types only is not."""
    for node in body:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node
        elif _is_type_checking(node):
            yield from _nodes(node.orelse, deep)
        elif deep or not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            for field in ("body", "orelse", "finalbody"):
                yield from _nodes(getattr(node, field, []), deep)
            for handler in getattr(node, "handlers", []):
                yield from _nodes(handler.body, deep)


@cache
def imports(module, deep=True):
    """Absolute names of everything that a module imports, from within the package resolved to modules."""
    path = MODULES[module]
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    out = set()
    for node in _nodes(ast.parse(path.read_text(encoding="utf-8")).body, deep):
        if isinstance(node, ast.Import):
            out |= {a.name for a in node.names}
            continue
        base = node.module or ""
        if node.level:
            base = ".".join([*package[:len(package) - node.level + 1], *([node.module] if node.module else [])])
        for alias in node.names:
            full = f"{base}.{alias.name}"
            out.add(full if full in MODULES else base)
    return frozenset(out)


def uses(module, name):
    return any(i == name or i.startswith(name + ".") for i in imports(module))


def test_the_reader_of_imports_reads_them():
    assert "bayes_dea.errors" in imports("bayes_dea.cli")
    assert "bayes_dea.calibration" in imports("bayes_dea.commands.calibrate")
    assert "bayes_dea.calibration" not in imports("bayes_dea.commands.calibrate", deep=False)
    assert any(uses(m, "matplotlib") for m in MODULES if m.startswith("bayes_dea.report."))


@pytest.mark.parametrize("module", sorted(MODULES))
def test_rules(module):
    if not module.startswith("bayes_dea.report"):
        assert not uses(module, "matplotlib"), "only the report draws"
        assert not uses(module, "jinja2"), "only the report makes pages"
    if module not in ("bayes_dea.cli", "bayes_dea.__main__") and not module.startswith("bayes_dea.commands"):
        assert not uses(module, "bayes_dea.commands"), "nothing imports the command line"
        assert not uses(module, "bayes_dea.cli"), "nothing imports the command line"
        assert not uses(module, "typer"), "only the command line knows it is one"
    if module.startswith("bayes_dea.bench"):
        for room in ("models", "likelihood", "noise", "fit", "calibration", "forward", "assemble"):
            assert not uses(module, f"bayes_dea.{room}"), "a bench that shares the models' code proves nothing"
    if module.startswith(("bayes_dea.models", "bayes_dea.noise", "bayes_dea.campaign", "bayes_dea.priors")):
        for room in ("likelihood", "fit", "checks", "report", "calibration", "bench"):
            assert not uses(module, f"bayes_dea.{room}"), "never back along the road"
    if module.startswith("bayes_dea.likelihood"):
        for room in ("fit", "checks", "report", "calibration"):
            assert not uses(module, f"bayes_dea.{room}"), "never back along the road"
    if module.startswith("bayes_dea.gauss_newton"):
        assert not uses(module, "bayes_dea.mismatch"), "what fits knows nothing of what is looked for by it"
    if module.startswith("bayes_dea.mismatch."):
        steps = ("where", "search", "readings")
        step = next((k for k, s in enumerate(steps) if module.startswith(f"bayes_dea.mismatch.{s}")), None)
        for later in steps[step + 1 :] if step is not None else ():
            assert not uses(module, f"bayes_dea.mismatch.{later}"), "never back along the road"
    for stage, later in (("electrostatics", ("mechanics", "networks", "static")),):
        if module == f"bayes_dea.models.{stage}":
            assert not any(uses(module, f"bayes_dea.models.{x}") for x in later), "a stage knows no later stage"


def test_no_cycles():
    """Modules in import order: each one can be read before those that use it."""
    graph = {m: {i for i in imports(m, deep=False) if i in MODULES and i != m} for m in MODULES}
    # a package's __init__ gathers names of its modules for others
    done: set[str] = set()
    stack: list[str] = []

    def visit(m):
        assert m not in stack, " -> ".join([*stack[stack.index(m):], m])
        if m in done:
            return
        stack.append(m)
        for n in sorted(graph[m]):
            visit(n)
        stack.pop()
        done.add(m)

    for m in sorted(graph):
        visit(m)
    assert done == set(MODULES)


def test_no_cycles_among_rooms():
    """Rooms, with imports inside functions: never back along the road, except that saving a result draws its page."""
    def room(module):
        return module.split(".")[1] if "." in module else ""

    graph: dict[str, set[str]] = {}
    for m in MODULES:
        graph.setdefault(room(m), set()).update(room(i) for i in imports(m) if i in MODULES and room(i) != room(m))
    graph["store"].remove("report")
    for start in graph:
        seen: set[str] = set()
        front = set(graph[start])
        while front:
            seen |= front
            front = {j for i in front for j in graph[i]} - seen
        assert start not in seen, f"{start} imports itself through others"


@pytest.mark.parametrize("module", sorted(m for m in MODULES if MODULES[m].name != "__init__.py"))
def test_every_module_says_what_it_is_for(module):
    path = MODULES[module]
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert text, path.name
