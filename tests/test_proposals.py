"""Every command and option that the tool, its pages or its READMEs tell somebody to type exists."""

import ast
import functools
import importlib.util
import re
import subprocess
from pathlib import Path

import pytest
import typer

from bayes_dea import cli

ROOT = Path(__file__).resolve().parents[1]
#: options of other programs that texts name: of pip, pytest, git and the like
FOREIGN = {"--ignore", "--lf", "--ff"}


def options_of(command: object) -> set[str]:
    return {o for p in command.params for o in (*p.opts, *p.secondary_opts)} | {"--help"}  # type: ignore[attr-defined]


GROUP = typer.main.get_command(cli.app)
OPTIONS = {verb: options_of(command) for verb, command in GROUP.commands.items()}  # type: ignore[attr-defined]
OF_THE_GROUP = options_of(GROUP) | {"--no-color"}
ANY = set().union(*OPTIONS.values()) | OF_THE_GROUP


def tracked(*patterns: str) -> list[Path]:
    listed = subprocess.run(["git", "ls-files", *patterns], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git repository")
    return [ROOT / name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def strings(path: Path) -> list[str]:
    """The texts of a module, f-strings with X for what is put in; docstrings among them."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    parts = {id(v) for n in ast.walk(tree) if isinstance(n, ast.JoinedStr) for v in n.values}
    out = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            out.append("".join(str(v.value) if isinstance(v, ast.Constant) else "X" for v in node.values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            out.append(node.value)
    return out


@functools.cache
def texts() -> tuple[tuple[str, str], ...]:
    """(file, text) of all that somebody may read."""
    out = [(str(p.relative_to(ROOT)), t) for p in tracked("bayes_dea/*.py") for t in strings(p)]
    pages = [p for p in tracked("*.md", "bayes_dea/*.j2", "bayes_dea/*.toml", "priors/*.toml", "runs/*.toml")]
    return (*out, *((str(p.relative_to(ROOT)), p.read_text(encoding="utf-8")) for p in pages))


def commands(text: str) -> list[tuple[str, list[str]]]:
    """(verb, options) of every call in a text; a line that ends in a backslash goes on."""
    found = []
    for call in re.findall(r"(?:^|[\s`'\"/(>])bayes-dea +((?:\\\n|[^\n`'&|;#])*)", text):
        words = call.replace("\\\n", " ").split()
        if not words:
            continue
        verb = words[0].strip(".,:)'\"<>")
        options = [re.split(r"[=.,:)\]]", w.strip("[("))[0] for w in words[1:] if re.match(r"[\[(]?--?[a-z]", w)]
        found.append((verb, options))
    return found


def test_calls_name_verbs_and_options_that_exist():
    # "bayes-dea kernel ..." and the like in prose are names, not calls: a call has an option, or stands in a code line
    wrong, seen = [], 0
    for file, text in texts():
        for verb, options in commands(text):
            if verb.startswith("-"):
                wrong += [f"{file}: {verb}"] if verb not in OF_THE_GROUP | {"--install-completion"} else []
                continue
            if verb in OPTIONS:
                seen += 1
                wrong += [f"{file}: bayes-dea {verb} {o}" for o in options if o not in OPTIONS[verb]]
            elif options and verb not in ("X", "VERB"):
                wrong.append(f"{file}: bayes-dea {verb}")
    assert seen > 40
    assert not wrong, "\n".join(wrong)


def test_options_in_messages_exist():
    """Also where the call is not written out: "give --anew", "see --signal"."""
    wrong = []
    for file, text in texts():
        if not file.endswith(".py") or "/paper_" in file:
            continue
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text):
            if option not in ANY | FOREIGN | {"--install-completion", "--show-completion"}:
                wrong.append(f"{file}: {option}")
    assert not wrong, "\n".join(wrong)


def test_nothing_is_proposed_that_was_only_planned():
    for file, text in texts():
        assert not re.search(r"FILE\.py|new-model|model of your own (?:reads|may)", text), file


def test_modules_to_run_exist():
    """`python -m NAME` and `python PATH` in READMEs and texts."""
    wrong = []
    for file, text in texts():
        for module in re.findall(r"python3? -m ([\w.]+)", text):
            name = module.rstrip(".")
            inside = name.startswith(("bayes_dea.", "tests."))
            files = [ROOT / f"{name.replace('.', '/')}{end}" for end in (".py", "/__main__.py")]
            known = any(f.is_file() for f in files) if inside else importlib.util.find_spec(name) is not None
            wrong += [] if known else [f"{file}: python -m {name}"]
        for path in re.findall(r"python3? ([\w./-]+\.py)", text):
            if not ((ROOT / path).is_file() or (ROOT / file).parent.joinpath(path).is_file()):
                wrong.append(f"{file}: python {path}")
    assert not wrong, "\n".join(wrong)
