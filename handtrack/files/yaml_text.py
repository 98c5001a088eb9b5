"""YAML as calibration files use it: mappings, lists, numbers and texts, read by PyYAML.

Its safe loader resolves more than a calibration means (`on` is a name, `12:30` a text) and, of small files, fills the memory by
aliases or the stack by depth: those are left out or refused here.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar

import yaml

_DEEPEST = 40  # levels
_TEXT = "tag:yaml.org,2002:"
_WORDS = {
    "null": r"(~|null|Null|NULL|)$",
    "bool": r"(true|True|TRUE|false|False|FALSE)$",
    "int": r"[-+]?[0-9]{1,18}$",
    "float": r"([-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|Nan|NAN))$",
}
"""what is no text where it stands without quotes"""


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}
    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent) or self.peek_event().anchor is not None:
            raise self._wrong("anchors and aliases are not read: write the value itself")
        self.depth += 1
        if self.depth > _DEEPEST:
            raise self._wrong(f"nested more than {_DEEPEST} times")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def _wrong(self, what: str) -> yaml.MarkedYAMLError:
        return yaml.MarkedYAMLError(problem=what, problem_mark=self.peek_event().start_mark)

    def any_of(self, node: yaml.Node) -> Any:
        """Return a mapping, or a value of whatever tag, such as `!!opencv-matrix`: no tag is obeyed."""
        if isinstance(node, yaml.ScalarNode):
            return node.value
        if isinstance(node, yaml.SequenceNode):
            return [self.construct_object(child, deep=True) for child in node.value]
        assert isinstance(node, yaml.MappingNode)
        table: dict[Any, Any] = {}
        for name, value in node.value:
            key = name.value if isinstance(name, yaml.ScalarNode) else None
            if key is None or key in table:
                what = "a key must be a text" if key is None else f"the key '{key}' stands twice"
                raise yaml.MarkedYAMLError(problem=what, problem_mark=name.start_mark)
            table[key] = self.construct_object(value, deep=True)
        return table


for _name, _pattern in _WORDS.items():
    _Loader.add_implicit_resolver(_TEXT + _name, re.compile(_pattern), None)
_Loader.add_constructor(_TEXT + "int", lambda _, node: int(node.value))  # 010 is ten
_Loader.add_constructor(_TEXT + "map", _Loader.any_of)
_Loader.add_constructor(None, _Loader.any_of)  # pyright: ignore[reportArgumentType]: any other tag


def parse_yaml(text: str) -> Any:
    """Return mappings as dict, lists as list, and numbers, texts, true, false and null.

    Raises ValueError, with the line, for what is no YAML or goes beyond this part of it.
    """
    lines = (
        "" if line.startswith("%") else line for line in text.splitlines()
    )  # OpenCV's %YAML:1.0 is none
    try:
        return yaml.load("\n".join(lines), _Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        raise ValueError(f"{where}{getattr(error, 'problem', None) or error}") from None
