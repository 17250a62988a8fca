"""`impasto formats`: the formats that films are written in, and their profiles."""

from __future__ import annotations

from impasto.cli.console import emit, print_table, table
from impasto.cli.options import JsonFlag
from pipeline.formats import OUTPUTS


def formats(as_json: JsonFlag = False) -> None:
    """List the output formats, their extensions, and their profiles: the usual one first."""
    if as_json:
        emit([
            {
                "name": form.name, "title": form.title, "suffixes": [*form.suffixes, *form.frame_suffixes],
                "profiles": [
                    {"name": each.name, "title": each.title, "help": each.help, "depth_bits": each.depth_bits,
                     "alpha": each.has_alpha, "quality": each.has_quality}
                    for each in form.profiles
                ],
            }
            for form in OUTPUTS.values()
        ])  # fmt: skip
        return
    rows = table("Format", "Files", "Profile", "", "Opacity", "Quality")
    for form in OUTPUTS.values():
        files = ", ".join((*form.suffixes, *form.frame_suffixes))
        for at, each in enumerate(form.profiles):
            about = f"{each.title}. {each.help}" if each.help else each.title
            first = (form.name, files) if at == 0 else ("", "")
            rows.add_row(
                *first, each.name, about, *("yes" if has else "" for has in (each.has_alpha, each.has_quality))
            )
    print_table(rows)
