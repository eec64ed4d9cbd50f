"""How large each room of the package is, in what a reader has to hold in mind; lines aside."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

COLUMNS = 'modules', 'statements', 'choices', 'numbers', 'constants', 'wide', 'single'
# A function of more parameters is wide; a number within these needs no name.
_PARAMETERS, _PLAIN = 6, 2

_BRANCH = ast.If, ast.While, ast.IfExp, ast.Assert, ast.ExceptHandler, ast.match_case
_FUNCTION = ast.FunctionDef, ast.AsyncFunctionDef
_DOCUMENTED = ast.Module, ast.ClassDef, *_FUNCTION
_IMPORT = ast.Import, ast.ImportFrom


def sizes(package: Path) -> dict[str, dict[str, int]]:
    """Per room of a package, and of all of it.

    Statements are those of the syntax tree but docstrings and imports; choices are branches,
    comparisons, operands of `and` and `or`, and filters; numbers are literals other than -2 to 2;
    constants are numbers with a name in a module; single are modules that one other one imports.
    """
    trees = {path.relative_to(package): ast.parse(path.read_text()) for path in _files(package)}
    modules = {_name(package.name, path): path for path in trees}
    users = defaultdict(set)
    for name, path in modules.items():
        for other in _imported(trees[path]):
            if other in modules and other != name:
                users[other].add(name)
    rooms: dict[str, Counter] = defaultdict(Counter)
    for name, path in modules.items():
        counts = Counter(_counted(trees[path]))
        counts['single'] = int(len(users[name]) == 1 and path.name != '__init__.py')
        for room in (path.parts[0] if len(path.parts) > 1 else '(top)', 'all'):
            rooms[room].update(counts)
    order = sorted(rooms, key=lambda room: (room == 'all', room))
    return {room: {column: rooms[room][column] for column in COLUMNS} for room in order}


def _files(package: Path) -> list[Path]:
    return sorted(package.rglob('*.py'))


def _name(package: str, path: Path) -> str:
    parts = path.with_suffix('').parts
    return '.'.join((package, *(parts[:-1] if parts[-1] == '__init__' else parts)))


def _imported(tree: ast.Module) -> Iterator[str]:
    """Absolute names alone: the package has no relative imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def _counted(tree: ast.Module) -> Iterator[str]:
    """The name of a column for each thing that counts there."""
    yield 'modules'
    documents = {
        id(node.body[0])
        for node in ast.walk(tree)
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.stmt) and id(node) not in documents:
            yield from () if isinstance(node, _IMPORT) else ('statements',)
        if isinstance(node, _BRANCH):
            yield 'choices'
        elif isinstance(node, ast.Compare):
            yield from ['choices'] * len(node.ops)
        elif isinstance(node, ast.BoolOp):
            yield from ['choices'] * (len(node.values) - 1)
        elif isinstance(node, ast.comprehension):
            yield from ['choices'] * len(node.ifs)
        elif isinstance(node, _FUNCTION) and _parameters(node.args) > _PARAMETERS:
            yield 'wide'
        elif isinstance(node, ast.Constant) and _is_number(node):
            yield from () if node.value in range(_PLAIN + 1) else ('numbers',)
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            yield from ('constants' for value in _values(node) if _is_number(value))


def _values(node: ast.Assign | ast.AnnAssign) -> list[ast.expr]:
    """What is assigned, name by name where several names are given."""
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    several = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
    return node.value.elts if several else [node.value]


def _parameters(arguments: ast.arguments) -> int:
    every = *arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs
    return sum(each.arg not in ('self', 'cls') for each in every)


def _is_number(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        return _is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) and _is_number(node.right)
    if isinstance(node, ast.Attribute):
        return node.attr in ('pi', 'tau', 'e', 'inf', 'nan')
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)
