"""docs/reports/mutations.md: what survived, module by module, with a judgement each that stays when the table is made anew."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.mutants import Mutant

UNJUDGED = "**open**"
DRAWN, DRAWN_END = "<!-- drawn -->", "<!-- /drawn -->"
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


def drawn(page: Path, outcomes: Sequence[Outcome], seed: int) -> None:
    """Write the section of mutants drawn from all rooms anew; judgements stay as in `written`."""
    text = page.read_text(encoding="utf-8")
    before, rest = text.split(DRAWN)
    old, after = rest.split(DRAWN_END)
    cells = (line.strip("| ").split(" | ") for line in old.splitlines() if line.startswith("| `"))
    known = {(row[0], row[2]): row[3] for row in cells if len(row) == 4}
    left = [(o, mutant) for o in outcomes for mutant in o.survivors]
    section = [
        f"{len(outcomes) - len(left)} of {len(outcomes)} noticed, seed {seed}.",
        "",
        "| module | line | change | judgement |",
        "|---|---|---|---|",
    ]
    for outcome, mutant in left:
        name = f"`{outcome.module}`"
        judgement = known.get((name, mutant.change), UNJUDGED)
        section.append(f"| {name} | {mutant.line} | {mutant.change} | {judgement} |")
    whole = "\n".join([DRAWN, *section, DRAWN_END])
    page.write_text(before + whole + after, encoding="utf-8")
