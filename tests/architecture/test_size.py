"""Nothing grows until nobody reads it: functions, files, names of classes."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
SOURCES = sorted((REPOSITORY / "fipt").rglob("*.py"))

LONGEST_FILE, LONGEST_FUNCTION, MOST_PARAMETERS = 450, 60, 8
REASON = "# long:"
"""A comment that begins so, right above a function's ``def`` or decorators, says why it is longer than others."""


@cache
def nodes(path: Path) -> list[ast.AST]:
    """All nodes of a file's syntax tree; every test asks for them."""
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))))


def functions() -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef, bool]]:
    """Place, node, and whether a reason stands above it, of every function of the package."""
    for path in SOURCES:
        lines = path.read_text(encoding="utf-8").splitlines()
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                first = min([node.lineno, *(mark.lineno for mark in node.decorator_list)])
                above = first - 2
                while above >= 0 and lines[above].strip().startswith("#"):
                    if lines[above].strip().startswith(REASON):
                        break
                    above -= 1
                reasoned = above >= 0 and lines[above].strip().startswith(REASON)
                yield f"{path.relative_to(REPOSITORY)}:{node.lineno} {node.name}", node, reasoned


def parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Number of parameters; self and cls do not count."""
    names = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def test_functions_are_short() -> None:
    lengths = {place: (node.end_lineno or node.lineno) - node.lineno + 1 for place, node, why in functions() if not why}
    assert {place: length for place, length in lengths.items() if length > LONGEST_FUNCTION} == {}


def test_functions_have_few_parameters() -> None:
    counts = {place: parameters(node) for place, node, why in functions() if not why}
    assert {place: count for place, count in counts.items() if count > MOST_PARAMETERS} == {}


def test_files_are_short() -> None:
    lengths = {
        str(path.relative_to(REPOSITORY)): len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES
    }
    assert {path: length for path, length in lengths.items() if length > LONGEST_FILE} == {}


def test_names_of_classes_are_unique() -> None:
    places = defaultdict(list)
    for path in SOURCES:
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(str(path.relative_to(REPOSITORY)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_only_the_command_line_prints() -> None:
    """Everything else logs: `fipt.cli` decides how that looks."""
    cli = REPOSITORY / "fipt" / "cli"
    guilty = [
        f"{path.relative_to(REPOSITORY)}:{node.lineno}"
        for path in SOURCES
        if cli not in path.parents
        for node in nodes(path)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
    ]
    assert guilty == []
