"""Examples in the OpenAPI document, by the name of their schema: of every request body, and of the main answers."""

from __future__ import annotations

from pipeline.method_names import DEFAULT
from pipeline.methods import method
from workers.contract.request import Json

SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
VIDEO = f"ast_{SHA256}"
AT = 1795219200.0

_CHOSEN = method(DEFAULT)
_PARAMS = dict(_CHOSEN.examples[0].params)
_ARTEFACTS = list(_CHOSEN.artefacts[:1])
_JOB_IN: Json = {
    "method": DEFAULT,
    "inputs": {"video": VIDEO},
    "params": _PARAMS,
    "seed": 0,
    "output": {"format": "mp4", "quality": 18, "artefacts": _ARTEFACTS},
    "labels": {"shot": "12"},
}
_REQUEST: Json = {
    "method": DEFAULT,
    "inputs": {"video": VIDEO},
    "params": _PARAMS,
    "seed": 0,
    "output": {
        "format": "mp4",
        "quality": 20,
        "artefacts": [],
        "report": False,
        "profile": "",
        "alpha": "auto",
        "colour": "",
        "passes": [],
        "passes_format": "",
    },
    "priority": 0,
    "name": "harbour",
    "labels": {"shot": "12"},
    "webhook": "",
    "frames": None,
    "on_damage": "warn",
    "source": {
        "picture": None,
        "sound": None,
        "fields": "auto",
        "premultiplied": False,
        "colour": "",
        "colour_view": "",
    },
}
_ASSET: Json = {
    "id": VIDEO,
    "sha256": SHA256,
    "size_bytes": 1482034,
    "filename": "clip.mp4",
    "media_type": "video/mp4",
    "kind": "video",
    "info": {"width": 1280, "height": 720, "frames": 96, "fps": 24.0, "duration_s": 4.0, "codec": "h264"},
    "created_at": AT,
    "owner": "",
}
_JOB: Json = {
    "id": "job_01HZX2",
    "state": "running",
    "request": _REQUEST,
    "owner": "",
    "created_at": AT,
    "updated_at": AT + 4,
    "started_at": AT + 1,
    "finished_at": None,
    "progress": 0.25,
    "eta_s": 9.0,
    "counts": {"running": 1, "waiting": 3},
    "steps": [
        {
            "name": "paint",
            "title": "Paint",
            "state": "running",
            "counts": {"running": 1, "waiting": 3},
            "progress": 0.25,
            "seconds": 3.1,
            "stages": {"decode": 0.2},
            "reused": 0,
            "cpu_s": 5.9,
            "peak_bytes": 412_000_000,
        }
    ],
    "error": None,
    "results": ["preview"],
    "warnings": [],
    "links": {
        "self": "/v1/jobs/job_01HZX2",
        "events": "/v1/jobs/job_01HZX2/events",
        "result": "/v1/jobs/job_01HZX2/result",
        "tasks": "/v1/jobs/job_01HZX2/tasks",
    },
}
_SHOT = {"shot": "main", "frame": 12}

EXAMPLES: dict[str, tuple[Json, ...]] = {
    # request bodies
    "JobIn": (_JOB_IN, {"method": DEFAULT, "inputs": {"video": VIDEO}}),
    "PreviewIn": ({"method": DEFAULT, "inputs": {"video": VIDEO}, "frame": 10, "max_side_px": 480},),
    "ExportIn": ({"format": "png"}, {"format": "webm", "quality": 28}),
    "EstimateIn": ({"request": _JOB_IN}, {"project": "prj_01HZX2", "range": [0, 48]}),
    "ProjectIn": ({"name": "Swan"},),
    "ProjectJobsIn": ({}, {"shots": ["main"], "priority": 10}),
    "LabelIn": ({"label": "sent to the client"},),
    "ShareIn": ({"days": 7, "comments": True},),
    "CommentIn": ({"shot": "s1", "frame": 42, "text": "The sky is too dark.", "author": "Mia"},),
    "PaintIn": (_SHOT | {"max_side_px": 640},),
    "RegionsIn": (_SHOT,),
    "DirectionsIn": (_SHOT | {"spacing_px": 12},),
    "KeysIn": ({"shot": "main", "count": 8},),
    "FlickerIn": (_SHOT | {"frame": 24}, {"shot": "main", "frames": [0, 48], "count": 24}),
    "ClustersIn": ({"shot": "main", "layer": "l1"},),
    "CutsIn": ({"shot": "main", "layer": "l1"},),
    "ObjectIn": (_SHOT | {"frame": 12, "box": [0.2, 0.1, 0.6, 0.9]},),
    "MatteIn": ({"shot": "main", "marks": [{"frame": 12, "box": [0.2, 0.1, 0.6, 0.9]}]},),
    "SpreadIn": (_SHOT | {"around": 6},),
    "PropagateIn": ({"shot": "main", "key": 12, "around": 3},),
    "StylesIn": (_SHOT | {"cards": [{"id": "soft", "set": {"params": _PARAMS}}]},),
    "KeyIn": ({"name": "alice", "scopes": ["read", "submit"], "quotas": {"active_jobs": 20}},),
    "MemberIn": ({"role": "editor"},),
    "OwnerIn": ({"kind": "group", "name": "Heron, season 2", "quotas": {"running_tasks": 8}},),
    "OwnerPatch": ({"quotas": {"active_jobs": 50, "asset_bytes": None}},),
    "TransferIn": ({"to": "usr_01HZX4"},),
    "RuleIn": ({"days": 30, "label": "quality", "value": "draft"},),
    "PriorityIn": ({"priority": None}, {"priority": 20}),
    "JobsActionIn": ({"action": "cancel", "jobs": ["job_01HZX2", "job_01HZX3"]},),
    "ReasonIn": ({"reason": "kernel update"},),
    # answers
    "Asset": (_ASSET,),
    "AssetList": ({"items": [_ASSET], "cursor": None},),
    "JobOut": (_JOB,),
    "JobOutList": ({"items": [_JOB], "cursor": None},),
    "Problem": (
        {
            "type": "urn:impasto:problem:bad-parameter",
            "title": "A parameter is wrong",
            "status": 422,
            "detail": "Unknown parameter 'line'.",
            "code": "bad-parameter",
            "field": "params.line",
            "value": "off",
            "remedy": "Did you mean 'lines'?",
            "instance": "/v1/jobs",
        },
    ),
}
