"""Law 5: everything wrong with a request is said when it is submitted, in one list, each with its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pipeline.errors import ImpastoError
from pipeline.methods.base import InputSpec, Method
from tests.laws.cases import HEIGHT, WIDTH, Case, document, generated, properties_of
from workers.contract.record import Asset
from workers.contract.request import JobRequest, OutputSpec
from workers.scheduling.check_request import check_request

_KINDS = {"video": "video", "image": "image", "image-or-video": "image", "images": "archive", "json": "json"}


@dataclass
class Request:
    """A request under construction: assets by input, documents, and the places where it is wrong."""

    chosen: Method
    params: dict[str, Any]
    assets: dict[str, Asset]
    documents: dict[str, Any]
    output: dict[str, Any] = field(default_factory=dict)
    frames: tuple[int, int] | None = None
    wrong: list[str] = field(default_factory=list)

    def check(self) -> list[str]:
        """Places of the faults that the submission reports."""
        output = OutputSpec(**self.output)
        inputs = {name: asset.id for name, asset in self.assets.items()}
        request = JobRequest(self.chosen.name, inputs, self.params, output=output, frames=self.frames)
        by_id = {asset.id: self.documents.get(name) for name, asset in self.assets.items()}
        try:
            check_request(request, self.assets, lambda asset: by_id[asset.id])
        except ImpastoError as error:
            return [one.field for one in (error, *error.others)]
        return []


def request_of(case: Case) -> Request:
    """A request without a fault."""
    specs = {spec.name: spec for spec in case.chosen.inputs}
    names = ("video", *case.inputs)
    assets = {name: _asset(specs[name], case, number) for number, name in enumerate(names)}
    documents = {name: document(case, name) for name in names if specs[name].kind == "json"}
    return Request(case.chosen, dict(case.params), assets, documents)


def _asset(spec: InputSpec, case: Case, number: int) -> Asset:
    size = (76, 60) if spec.name.startswith("style") and spec.name != "styled" else (WIDTH, HEIGHT)
    info: dict[str, Any] = {"width": size[0], "height": size[1], "frames": case.frames, "fps": 25.0, "duration_s": 1.0}
    if spec.kind == "images":
        drawn = [2] if spec.name == "labels" else [k for k in (1, 4) if k < case.frames]
        info |= {"numbers": [[k, k, 1] for k in drawn], "frames": len(drawn), "fault": {}}
    return Asset(f"ast_{number}", "", 1, f"{spec.name}", "", _KINDS[spec.kind], info, 0.0)


# -- faults: each makes one thing wrong, and returns its place; None: the request has nothing of the kind

Fault = Callable[[Request, np.random.Generator], str | None]


def _pick(request: Request, draw: np.random.Generator, fits: Callable[[InputSpec], bool]) -> str | None:
    names = [spec.name for spec in request.chosen.inputs if spec.name in request.assets and fits(spec)]
    wrong = {place.split("[")[0].removeprefix("inputs.") for place in request.wrong}
    compared = {name: _compared_with(request, name) for name in request.assets}
    taken = wrong.union(*(compared.get(name, ()) for name in wrong))
    names = [name for name in names if name not in taken and not compared[name] & wrong]
    return str(draw.choice(names)) if names else None


def _compared_with(request: Request, name: str) -> set[str]:
    """The inputs whose size or length an input must have: a fault of theirs leaves nothing to compare."""
    fits = next((spec.fits for spec in request.chosen.inputs if spec.name == name), None)
    return set() if fits is None else {fits.size, fits.aspect, fits.frames} - {"", "video", None}


def _changed(request: Request, name: str, **info: Any) -> str:
    asset = request.assets[name]
    request.assets[name] = replace(asset, info={**asset.info, **info})
    return f"inputs.{name}"


def other_size(request: Request, draw: np.random.Generator) -> str | None:
    name = _pick(request, draw, lambda spec: spec.fits.size in request.assets)
    return name and _changed(request, name, width=40)


def other_aspect(request: Request, draw: np.random.Generator) -> str | None:
    name = _pick(request, draw, lambda spec: spec.fits.aspect in request.assets)
    return name and _changed(request, name, width=130)


def too_short(request: Request, draw: np.random.Generator) -> str | None:
    name = _pick(request, draw, lambda spec: spec.fits.frames in request.assets)
    return name and _changed(request, name, frames=3)


def no_such_frame(request: Request, draw: np.random.Generator) -> str | None:
    name = _pick(request, draw, lambda spec: spec.kind == "images")
    return name and _changed(request, name, numbers=[[1, 1, 1], [900, 900, 1]])


def wrong_kind(request: Request, draw: np.random.Generator) -> str | None:
    name = _pick(request, draw, lambda spec: spec.kind != "json" and spec.name != "video")
    if name is None:
        return None
    request.assets[name] = replace(request.assets[name], kind="json", info={})
    return f"inputs.{name}"


def broken_document(request: Request, draw: np.random.Generator) -> str | None:
    name = _pick(request, draw, lambda spec: spec.name in request.chosen.input_checks)
    if name is None:
        return None
    request.documents[name] = {"version": "nine", "nonsense": [1]}
    return f"inputs.{name}"


def unknown_parameter(request: Request, draw: np.random.Generator) -> str:
    request.params["brightnes"] = 1
    return "params.brightnes"


def out_of_range(request: Request, draw: np.random.Generator) -> str:
    name = str(draw.choice(sorted(request.chosen.Params.model_fields)))
    request.params[name] = 1e9 if draw.random() < 0.5 else "plaid"
    return f"params.{name}"


def unsorted_keys(request: Request, draw: np.random.Generator) -> str:
    varying = request.chosen.Params.varying()
    name = str(draw.choice(varying or ("seedling",)))
    low = properties_of(request.chosen)[name]["minimum"] if varying else 0
    request.params[name] = [[5, low], [2, low]]
    return f"params.{name}"


def unknown_input(request: Request, draw: np.random.Generator) -> str:
    request.assets["matt"] = next(iter(request.assets.values()))
    return "inputs.matt"


def missing_input(request: Request, draw: np.random.Generator) -> str | None:
    needs = [spec.needs for spec in request.chosen.inputs if spec.needs and spec.name in request.assets]
    required = [spec.name for spec in request.chosen.inputs if spec.required and spec.name in request.assets]
    free = [name for name in {*needs, *required[1:]} if f"inputs.{name}" not in request.wrong]
    if not free or any(place.startswith("inputs.") for place in request.wrong):
        return None
    name = str(draw.choice(sorted(free)))
    del request.assets[name]
    return f"inputs.{name}"


def unknown_artefact(request: Request, draw: np.random.Generator) -> str:
    request.output["artefacts"] = ("holograms",)
    return "output.artefacts"


def bad_output(request: Request, draw: np.random.Generator) -> str:
    request.output["quality"] = 99
    return "output.quality"


def piece_outside(request: Request, draw: np.random.Generator) -> str:
    request.frames = (3, 4000)
    return "frames"


FAULTS: tuple[Fault, ...] = (
    other_size, other_aspect, too_short, no_such_frame, wrong_kind, broken_document, unknown_parameter, out_of_range,
    unsorted_keys, unknown_input, missing_input, unknown_artefact, bad_output, piece_outside,
)  # fmt: skip


def everything_wrong_is_said(seed: int) -> str | None:
    """A request with up to four faults is refused with all of them; one without a fault is accepted."""
    draw = np.random.default_rng(seed)
    request = request_of(generated(seed))
    if unexpected := request.check():
        return f"a right request is refused: {unexpected}"
    for index in draw.choice(len(FAULTS), size=int(draw.integers(1, 5)), replace=False):
        place = FAULTS[int(index)](request, draw)
        request.wrong += [place] if place else []
    said = request.check()
    missed = [place for place in request.wrong if not any(_same(place, one) for one in said)]
    return f"{request.chosen.name}: not said: {missed} among {said}" if missed else None


def _same(place: str, said: str) -> bool:
    return said == place or said.startswith((f"{place}[", f"{place}."))


def places(seeds: Iterator[int]) -> set[str]:
    """Names of the faults that some of the seeds contain."""
    found: set[str] = set()
    for seed in seeds:
        draw, request = np.random.default_rng(seed), request_of(generated(seed))
        for fault in FAULTS:
            if fault(request, draw):
                found.add(fault.__name__)
    return found
