"""``scene4d activities``: what can be searched for, and in which words."""

from pathlib import Path
from typing import Annotated, Any

from scene4d.cli.arguments import catalogue_option
from scene4d.cli.command import Answer, Job, command
from scene4d.cli.output import screen


@command("activities")
def activities(
    job: Job, catalogue: Annotated[list[Path] | None, catalogue_option()] = None
) -> Answer:
    """List what search understands, with examples: activities, states, and ways to say more.

    [bold]Examples[/bold]

      scene4d activities
      scene4d activities --catalogue mine.yaml --json
    """
    from scene4d.searching.activities.catalogue import load_catalogue
    from scene4d.searching.language import state_examples, ways_to_say

    rows = [
        {
            "name": one.name,
            "description": one.description,
            "roles": {role.name: list(role.classes) for role in one.roles},
            "phrases": list(one.phrases),
        }
        for one in load_catalogue(*(catalogue or ())).values()
    ]
    states = [{"predicates": said, "phrase": phrase} for said, phrase in state_examples()]
    ways = {name: list(examples) for name, examples in ways_to_say().items()}
    fields = {"activities": rows, "states": states, "ways": ways}
    return Answer(fields, lambda: _show(rows, states, ways))


def _show(
    rows: list[dict[str, Any]], states: list[dict[str, str]], ways: dict[str, list[str]]
) -> None:
    with screen() as console:
        for row in rows:
            console.print(row["name"], style="bold")
            console.print(f"  {row['description']}", soft_wrap=True)
            if row["phrases"]:
                console.print(f'  scene4d search SCENE "{row["phrases"][0]}"', style="dim")
            console.print()
        console.print(
            "States, which may be joined with one another and with activities", style="bold"
        )
        for row in states:
            console.print(f'  scene4d search SCENE "{row["phrase"]}"', style="dim", soft_wrap=True)
            console.print(f"    {row['predicates']}", markup=False, soft_wrap=True)
        console.print()
        console.print("Ways to say more; docs/search-language.md has all", style="bold")
        for name, examples in ways.items():
            console.print(f"  {name}")
            for phrase in examples:
                console.print(f'    scene4d search SCENE "{phrase}"', style="dim", soft_wrap=True)
