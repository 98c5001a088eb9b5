"""Mutants of a source file: each differs from it in one number, sign, comparison or choice."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

_OTHER_OPERATOR: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
_AT_THE_BOUND: dict[type, type] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}
_PAIRS = (("min", "max"), ("minimum", "maximum"), ("argmin", "argmax"), ("any", "all"))
_OTHER_NAME = {one: other for pair in _PAIRS for one, other in (pair, pair[::-1])}
_WORDS = (ast.JoinedStr, ast.Raise, ast.Assert, ast.Import, ast.ImportFrom)
"""what only tells or checks: left alone"""


@dataclass(frozen=True)
class Mutant:
    """One change of a source file."""

    line: int
    before: str
    after: str
    source: str

    @property
    def change(self) -> str:
        return f"`{_short(self.before)}` → `{_short(self.after)}`"


def mutants(source: str) -> list[Mutant]:
    """Return every mutant of a Python source, in the order of the file."""
    found = []
    body = source.encode()
    starts = [0, *accumulate(map(len, body.splitlines(keepends=True)))]
    for node in _nodes(ast.parse(source)):
        assert node.end_lineno is not None and node.end_col_offset is not None
        first = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        for changed in _changes(node):
            after = ast.unparse(ast.fix_missing_locations(changed))
            mutated = body[:first] + f"({after})".encode() + body[end:]
            found.append(Mutant(node.lineno, body[first:end].decode(), after, mutated.decode()))
    return sorted(found, key=lambda mutant: (mutant.line, mutant.before, mutant.after))


def _nodes(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions that decide or compute something; neither types nor words."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, _WORDS):
                continue
            if isinstance(child, ast.expr):
                yield child
            yield from _nodes(child)


def _changes(node: ast.expr) -> Iterator[ast.expr]:
    match node:
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(value=int() as value):
            yield ast.Constant(2 * value if value > 2 else value + 1)
        case ast.Constant(value=float() as value):
            yield ast.Constant(2.0 * value if value else 1.0)
        case ast.BinOp(left, op, right) if type(op) in _OTHER_OPERATOR:
            yield ast.BinOp(left, _OTHER_OPERATOR[type(op)](), right)
        case ast.Compare(left, [op], [right]):
            for table in (_OTHER_OPERATOR, _AT_THE_BOUND):
                if type(op) in table:
                    yield ast.Compare(left, [table[type(op)]()], [right])
        case ast.BoolOp(op, values):
            yield ast.BoolOp(_OTHER_OPERATOR[type(op)](), values)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            yield operand
        case ast.IfExp(test, body, orelse):
            yield ast.IfExp(test, orelse, body)
        case ast.Name(name) if name in _OTHER_NAME:
            yield ast.Name(_OTHER_NAME[name])
        case ast.Attribute(value, name) if name in _OTHER_NAME:
            yield ast.Attribute(value, _OTHER_NAME[name])


def _short(text: str) -> str:
    flat = " ".join(text.split()).replace("|", "\\|")
    return flat if len(flat) <= 60 else f"{flat[:40]} … {flat[-17:]}"
