"""docs/reports/mutations.md: what survived, module by module, with a judgement each that stays when the table is made anew."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.mutants import Mutant

UNJUDGED = "**open**"
_ROW = re.compile(r"^\| \d+ \| `(?P<line>.*)` \| (?P<change>`.*` → `.*`) \| (?P<judgement>.*) \|$")


@dataclass(frozen=True)
class Outcome:
    """What became of a module's mutants."""

    module: str
    source: str
    possible: int
    tried: int
    survivors: tuple[Mutant, ...]


def written(page: Path, outcome: Outcome, seed: int) -> None:
    """Write a module's section anew; judgements stay with the line and the change that they are about."""
    text = page.read_text(encoding="utf-8")
    head = f"### {outcome.module}\n"
    before, found, rest = text.partition(head)
    old, _, after = rest.partition("\n### ") if found else ("", "", "")
    after = f"\n### {after}" if after else ""
    known = {
        (m["line"], m["change"]): m["judgement"] for m in map(_ROW.match, old.split("\n")) if m
    }
    killed = outcome.tried - len(outcome.survivors)
    section = [
        head,
        f"{killed} of {outcome.tried} killed (of {outcome.possible} possible; seed {seed}).\n",
    ]
    if outcome.survivors:
        section += ["| line | code | change | judgement |", "|---|---|---|---|"]
    lines = outcome.source.splitlines()
    for mutant in outcome.survivors:
        code = lines[mutant.line - 1].strip().replace("|", "\\|")
        judgement = known.get((code, mutant.change), UNJUDGED)
        section.append(f"| {mutant.line} | `{code}` | {mutant.change} | {judgement} |")
    before = before.rstrip("\n") + "\n\n"
    page.write_text(before + "\n".join(section) + "\n" + after, encoding="utf-8")
