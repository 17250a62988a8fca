"""The formats that the pages name, for `web/src/api/formats.json`; `python -m service.page_formats` writes it."""

from __future__ import annotations

import json
import pathlib

from pipeline.formats import IMAGES, OUTPUTS
from pipeline.formats.base import OutputFormat, Profile
from workers.contract.request import Json

FILE = pathlib.Path(__file__).parent / "web" / "src" / "api" / "formats.json"
_VIDEO = "video/*,.mkv,.avi,.mov,.webm,.mp4,.zip"


def document() -> str:
    """The file's contents."""
    suffixes = ",".join(suffix for form in IMAGES for suffix in form.suffixes)
    facts: Json = {
        "outputs": [_output(form) for form in OUTPUTS.values()],
        "accept": {"video": f"{_VIDEO},{suffixes}", "image": f"image/*,{suffixes}"},
    }
    return json.dumps(facts, indent=2) + "\n"


def _output(form: OutputFormat) -> Json:
    return {
        "name": form.name, "title": form.title, "help": form.help, "file": "ZIP" if form.frame_suffixes else form.title,
        "hasQuality": any(profile.has_quality for profile in form.profiles), "lossy": form.lossy,
        "shownAs": form.shown_as,
        "suffix": (*form.suffixes, ".zip")[0], "profiles": [_profile(profile) for profile in form.profiles],
    }  # fmt: skip


def _profile(profile: Profile) -> Json:
    return {
        "name": profile.name, "title": profile.title, "help": profile.help, "hasQuality": profile.has_quality,
        "hasAlpha": profile.has_alpha,
    }  # fmt: skip


if __name__ == "__main__":
    FILE.write_text(document(), "utf-8")
