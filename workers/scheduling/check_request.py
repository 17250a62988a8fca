"""Checks of submitted requests. Everything that is known to fail is refused before the job is accepted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from urllib.parse import urlsplit

from pydantic import JsonValue

from pipeline.errors import BadInput, BadParameter, DamagedMedia, did_you_mean, together
from pipeline.methods import method, parse_params
from pipeline.methods.base import InputFacts, InputKind, InputSpec, Method, Params, missing_inputs
from pipeline.methods.input_check import input_faults
from pipeline.passes.facts import sentences
from pipeline.video.media import Note
from pipeline.video.numbered import no_such_frame
from pipeline.video.numbering import described, numbers_of_runs
from workers.contract.record import Asset
from workers.contract.request import (
    FAIL,
    MAX_LABEL_NAME,
    MAX_LABEL_VALUE,
    MAX_LABELS,
    MAX_NAME,
    MAX_PRIORITY,
    MAX_SEED,
    MAX_URL,
    WARN,
    JobRequest,
    OutputSpec,
)
from workers.jobs.frame_window import check_source, window_info
from workers.jobs.job_warnings import (
    DAMAGE_REMEDY,
    PASSES,
    depth_warning,
    no_effect_warning,
    note_warning,
    unused_warning,
)
from workers.scheduling.outputs import output_faults
from workers.scheduling.planning import expected_weights, steps_of, versions_of
from workers.store import Accepted

FITS: Mapping[InputKind, tuple[str, ...]] = {
    "video": ("video", "image", "archive"),
    "image": ("image", "video"),
    "image-or-video": ("image", "video", "archive"),
    "images": ("archive", "image"),
    "json": ("json",),
}
"""Kind of input -> kinds of asset that can be used for it."""


def check_request(
    request: JobRequest, assets: Mapping[str, Asset], read: Callable[[Asset], JsonValue] = lambda asset: None
) -> Accepted:
    """The request with its parameters complete, and warnings about what has no effect.

    Args:
        assets: input name -> the asset given for it.
        read: returns the document of a JSON asset; None: it is not checked. Raises ValueError.

    Raises:
        BadParameter: names the field, its value and the remedy.
        DamagedMedia: an input is damaged, and the request demands a failure then.
    """
    chosen = method(request.method)
    faults: list[BadInput] = []
    with _collected(faults):
        params = parse_params(chosen, request.params)
    parsed = chosen.Params() if faults else params
    faults += check_inputs(chosen, assets, parsed)
    faults += input_faults(chosen, parsed, _facts(chosen, parsed, request, assets, read, faults))
    faults += output_faults(chosen, parsed, request.output, assets.get("video"))
    with _collected(faults):
        check_source(request.source, assets["video"].info if "video" in assets else None)
    with _collected(faults):
        check_frames(request.frames, assets.get("video"))
    with _collected(faults):
        _check_envelope(request)
    with _collected(faults):
        _check_damage(request, assets)
    if faults:
        raise together(faults)
    info = window_info(assets["video"].info if "video" in assets else {}, request.frames, request.source)
    weights = expected_weights(chosen, params, info)
    steps, versions = steps_of(chosen, params), versions_of(chosen, params)
    wanted, piece = request.output, request.frames is not None
    kinds = info.get("passes", {}).get("kinds", ())
    unused = chosen.ineffective(params, request.inputs, False, piece, wanted.artefacts, wanted.passes, kinds)
    warnings = [no_effect_warning(found) for found in unused]
    if request.output.encoding.is_deep and chosen.depth_bits == 8:
        warnings.append(depth_warning(chosen.title, request.output.encoding.title))
    if request.output.quality != OutputSpec().quality and not request.output.encoding.has_quality:
        warnings.append(unused_warning("output.quality", f"{request.output.encoding.title} has one quality"))
    if request.source.premultiplied and not info.get("alpha", True):
        warnings.append(unused_warning("source.premultiplied", "the video has no opacity"))
    told = sentences(info.get("passes", {}), chosen.passes)
    warnings += [note_warning("video", Note(PASSES, message)) for message in told]
    return Accepted(request, params.model_dump(mode="json"), steps, weights, versions, tuple(warnings))


def _facts(
    chosen: Method, params: Params, request: JobRequest, assets: Mapping[str, Asset],
    read: Callable[[Asset], JsonValue], faults: list[BadInput],
) -> dict[str, InputFacts]:  # fmt: skip
    """Facts of the inputs by name. A document that cannot be read is a fault."""
    kinds, found = {spec.name: spec.kind for spec in chosen.inputs_of(params)}, dict[str, InputFacts]()
    for name, asset in assets.items():
        if name not in kinds or asset.kind not in FITS[kinds[name]]:
            continue
        info = asset.info
        with suppress(BadParameter):  # a stream that the video does not have is reported by itself
            info = window_info(info, None, request.source if name == "video" else None)
        size = int(info.get("width", 0)), int(info.get("height", 0))
        frames = int(info.get("frames", 0)) if kinds[name] == "video" or asset.kind == "archive" else 0
        document: JsonValue = None
        if kinds[name] == "json":
            try:
                document = read(asset)
            except ValueError as error:
                faults.append(BadParameter(f"The input is not JSON: {error}.", field=f"inputs.{name}"))
        images = kinds[name] == "images" and asset.kind == "archive" and "numbers" in info
        numbers = _frame_numbers(info["numbers"], assets.get("video")) if images else None
        found[name] = InputFacts(*size, frames, numbers, document)
    return found


def _frame_numbers(runs: Sequence[Sequence[int]], video: Asset | None) -> frozenset[int]:
    """Frames of numbered images: their numbers, or the places of these in a video that is a numbered sequence."""
    frames = numbers_of_runs(video.info.get("numbers", ()) if video is not None else ())
    place = {number: index for index, number in enumerate(frames)}
    return frozenset(place.get(number, number) for number in numbers_of_runs(runs))


@contextmanager
def _collected(faults: list[BadInput]) -> Iterator[None]:
    """Collect a refusal, so that all of them are reported together."""
    try:
        yield
    except (BadParameter, DamagedMedia) as fault:
        faults.append(fault)


def check_inputs(chosen: Method, assets: Mapping[str, Asset], params: Params) -> list[BadInput]:
    """Inputs that the method does not know, that are missing, and assets that do not fit."""
    specs = {spec.name: spec for spec in chosen.inputs_of(params)}
    found: list[BadInput] = [
        BadParameter(
            f"The method {chosen.name!r} has no input {name!r}.", field=f"inputs.{name}",
            remedy=did_you_mean(name, specs, "inputs"),
        )
        for name in assets if name not in specs
    ]  # fmt: skip
    found += [
        BadParameter(why, field=f"inputs.{spec.name}", remedy=f"Give one: {spec.help}")
        for spec, why in missing_inputs(specs.values(), assets)
    ]
    for name, asset in assets.items():
        if name in specs:
            with _collected(found):
                _check_asset(specs[name], asset, assets.get("video"))
    return found


def _check_asset(spec: InputSpec, asset: Asset, video: Asset | None) -> None:
    """Check that an asset can be used for an input."""
    if asset.kind not in FITS[spec.kind]:
        raise BadParameter(
            f"The input {spec.name!r} needs an asset of kind {spec.kind}; this one has kind {asset.kind}.",
            field=f"inputs.{spec.name}",
            value=asset.id,
            remedy=f"Use an asset of kind: {', '.join(FITS[spec.kind])}.",
        )
    if spec.kind == "images":
        _check_numbers(spec.name, asset, video)
    elif fault := asset.info.get("fault"):
        raise _not_a_sequence(spec.name, fault)


def _not_a_sequence(name: str, fault: Mapping[str, str]) -> BadParameter:
    return BadParameter(
        fault["message"], field=f"inputs.{name}", value=fault.get("value"),
        remedy=fault.get("remedy") or "Number the images by the frames they belong to.",
    )  # fmt: skip


def _check_numbers(name: str, asset: Asset, video: Asset | None) -> None:
    """Check that each image has the number of a frame."""
    if asset.kind != "archive" or video is None or "numbers" not in asset.info:
        return
    if not asset.info["numbers"]:
        raise _not_a_sequence(name, asset.info["fault"] or {"message": "The images have no numbers."})
    count = int(video.info.get("frames", 0))
    runs = video.info.get("numbers") or ([[0, count - 1, 1]] if count else [])
    valid = set(numbers_of_runs(runs))
    wrong = [number for number in numbers_of_runs(asset.info["numbers"]) if number not in valid]
    if wrong and valid:
        error = no_such_frame(wrong, described(runs), f"inputs.{name}")
        raise BadParameter(error.message, field=error.field, value=error.value, remedy=error.remedy)


def check_frames(frames: tuple[int, int] | None, video: Asset | None) -> None:
    """Check that the piece of the video is not empty and ends within the video."""
    if frames is None:
        return
    count = 0 if video is None else int(video.info.get("frames", 0))
    if not 0 <= frames[0] < frames[1] or (count and frames[1] > count):
        end = f"The video has {count} frames." if count else "Frames are counted from 0."
        _refuse("frames", list(frames), f"Use [first, end) with first < end. {end}")


def _check_damage(request: JobRequest, assets: Mapping[str, Asset]) -> None:
    """Refuse an input that is known to be damaged, if the request demands that. Raises BadParameter, DamagedMedia."""
    if request.on_damage not in (WARN, FAIL):
        _refuse("on_damage", request.on_damage, f"Use {WARN!r} or {FAIL!r}.")
    if request.on_damage == WARN or request.frames is not None:  # the requested piece of a damaged video may be intact
        return
    for name, asset in assets.items():
        if damage := asset.info.get("damage"):
            raise DamagedMedia(damage, field=f"inputs.{name}", value=asset.filename, remedy=DAMAGE_REMEDY)


def _check_envelope(request: JobRequest) -> None:
    if not -MAX_PRIORITY <= request.priority <= MAX_PRIORITY:
        _refuse("priority", request.priority, f"Use -{MAX_PRIORITY} to {MAX_PRIORITY}; higher is served first.")
    if not 0 <= request.seed <= MAX_SEED:
        _refuse("seed", request.seed, "Use 0 to 2**53 - 1.")
    if len(request.name) > MAX_NAME:
        _refuse("name", request.name, f"Use at most {MAX_NAME} characters.")
    _check_labels(request.labels)
    if request.webhook:
        _check_url(request.webhook)


def _check_labels(labels: Mapping[str, str]) -> None:
    if len(labels) > MAX_LABELS:
        _refuse("labels", len(labels), f"Use at most {MAX_LABELS} labels.")
    for name, value in labels.items():
        if not 1 <= len(name) <= MAX_LABEL_NAME:
            _refuse("labels", name, f"A label's name has 1 to {MAX_LABEL_NAME} characters.")
        if len(value) > MAX_LABEL_VALUE:
            _refuse(f"labels.{name}", value, f"A label's value has at most {MAX_LABEL_VALUE} characters.")


def _check_url(url: str) -> None:
    remedy = "Use an http or https URL with a host, for example https://example.org/hook."
    try:
        parts = urlsplit(url)
        sound = parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port or 1) > 0
    except ValueError:
        sound = False
    if not sound or len(url) > MAX_URL or not url.isprintable() or " " in url:
        _refuse("webhook", url, remedy)


def _fault(field: str, value: object, remedy: str) -> BadInput:
    return BadParameter(f"{field} cannot be {str(value)[:100]!r}.", field=field, value=value, remedy=remedy)


def _refuse(field: str, value: object, remedy: str) -> None:
    raise _fault(field, value, remedy)
