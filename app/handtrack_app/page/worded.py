"""Words on the page that say what is tracked: as the model's definition has it, once a session tells."""

from __future__ import annotations

from dataclasses import dataclass, field

from handtrack_app.protocol.snapshots import SessionSnapshot

_PARTS = {"hand": ("finger", "palm"), "body": ("limb", "trunk")}
"""by kind of model: what it has several of, and what they hang on"""


@dataclass
class Worded:
    """In a text, {kind} and {Kind} stand for what is tracked, hand or body, and {part} for one of its parts, {middle} for what they hang on."""

    kind: str = "hand"
    _given: list[tuple[object, dict[str, str]]] = field(default_factory=list)

    def of(self, text: str) -> str:
        """Return a text with its words."""
        part, middle = _PARTS[self.kind]
        said = text.replace("{kind}", self.kind).replace("{Kind}", self.kind.capitalize())
        return said.replace("{part}", part).replace("{middle}", middle)

    def on(self, widget: object, **texts: str) -> None:
        """Keep such properties of a widget (`label`, `hint`) in the words that hold."""
        self._given.append((widget, texts))
        self._write(widget, texts)

    def fit(self, session: SessionSnapshot) -> None:
        """Take the words of a session's model."""
        if session.kind != self.kind:
            self.kind = session.kind
            for widget, texts in self._given:
                self._write(widget, texts)

    def _write(self, widget: object, texts: dict[str, str]) -> None:
        for name, text in texts.items():
            if getattr(widget, name) != (said := self.of(text)):
                setattr(widget, name, said)
