"""Checks of submitted requests. Everything that is known to fail is refused before the job is accepted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import get_args
from urllib.parse import urlsplit

from pipeline.errors import BadInput, BadParameter, DamagedMedia, did_you_mean, together
from pipeline.methods import method, parse_params
from pipeline.methods.base import InputKind, Method, Params, missing_inputs
from pipeline.video.media import Fields, SourceOptions
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
)
from workers.jobs.frame_window import stream_info, window_info
from workers.jobs.job_warnings import DAMAGE_REMEDY
from workers.scheduling.outputs import check_output
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


def check_request(request: JobRequest, assets: Mapping[str, Asset]) -> Accepted:
    """The request with its parameters complete.

    Args:
        assets: input name -> the asset given for it.

    Raises:
        BadParameter: names the field, its value and the remedy.
        DamagedMedia: an input is damaged, and the request demands a failure then.
    """
    chosen = method(request.method)
    faults: list[BadInput] = []
    with _collected(faults):
        params = parse_params(chosen, request.params)
    with _collected(faults):
        check_inputs(chosen, assets, None if faults else params)
    with _collected(faults):
        check_output(chosen, request.output, assets.get("video"))
    with _collected(faults):
        check_source(request.source, assets.get("video"))
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
    return Accepted(request, params.model_dump(mode="json"), steps, weights, versions)


@contextmanager
def _collected(faults: list[BadInput]) -> Iterator[None]:
    """Collect a refusal, so that all of them are reported together."""
    try:
        yield
    except (BadParameter, DamagedMedia) as fault:
        faults.append(fault)


def check_inputs(chosen: Method, assets: Mapping[str, Asset], params: Params | None = None) -> None:
    """Check that every input is known to the method and fits, and that no required one is missing.

    Args:
        params: None: check only inputs that do not depend on parameters.
    """
    specs = {spec.name: spec for spec in (chosen.inputs if params is None else chosen.inputs_of(params))}
    for name in assets:
        if name not in specs:
            raise BadParameter(
                f"The method {chosen.name!r} has no input {name!r}.",
                field=f"inputs.{name}",
                remedy=did_you_mean(name, specs, "inputs"),
            )
    for spec, why in missing_inputs(specs.values(), assets):
        raise BadParameter(why, field=f"inputs.{spec.name}", remedy=f"Give one: {spec.help}")
    for name, asset in assets.items():
        kind = specs[name].kind
        if asset.kind not in FITS[kind]:
            raise BadParameter(
                f"The input {name!r} needs an asset of kind {kind}; this one has kind {asset.kind}.",
                field=f"inputs.{name}",
                value=asset.id,
                remedy=f"Use an asset of kind: {', '.join(FITS[kind])}.",
            )
        if kind == "images":
            _check_numbers(name, asset, assets.get("video"))
        elif fault := asset.info.get("fault"):
            raise _not_a_sequence(name, fault)


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


def check_source(source: SourceOptions, video: Asset | None) -> None:
    """Check that the video has the stream, and that fields are read in a known way."""
    if source.fields not in get_args(Fields):
        _refuse("source.fields", source.fields, f"Use one of: {', '.join(get_args(Fields))}.")
    if source.picture is not None and video is not None:
        stream_info(video.info, source.picture)


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


def _refuse(field: str, value: object, remedy: str) -> None:
    raise BadParameter(f"{field} cannot be {str(value)[:100]!r}.", field=field, value=value, remedy=remedy)
