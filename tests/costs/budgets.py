"""What each route may cost: data, checked by `test_costs`. A route without a row fails the test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Growth = Literal["flat", "linear"]


@dataclass(frozen=True)
class Ask:
    """A request to a route, and its budget.

    Attributes:
        route: verb and template of the address.
        request: verb and address, with placeholders of `measuring.Measured`.
        queries: maximum number of SQL statements, the caller's key included.
        growth: "flat": the rows visited do not depend on the numbers of jobs, projects and assets. "linear": they may.
        who: the key: anna has most jobs, cleo a few, root is an operator.
    """

    route: str
    request: str
    queries: int
    growth: Growth = "flat"
    who: str = "anna"
    body: Any = None
    headers: dict[str, str] | None = None


READS = (
    Ask("GET /v1/methods", "GET /v1/methods", 2),
    Ask("GET /v1/methods/{name}", "GET /v1/methods/multistyle", 2),
    Ask("GET /v1/methods/{name}/thumbnail", "GET /v1/methods/none/thumbnail", 2),
    Ask("GET /v1/methods/{name}/inputs/{input_name}/schema", "GET /v1/methods/multistyle/inputs/design/schema", 2),
    Ask(
        "GET /v1/methods/{name}/inputs/{input_name}/examples",
        "GET /v1/methods/multistyle/inputs/design/examples?frames=9",
        2,
    ),
    Ask("GET /v1/styles", "GET /v1/styles", 2),
    Ask("GET /v1/styles/{style_id}/picture", "GET /v1/styles/none/picture", 2),
    Ask("GET /v1/assets", "GET /v1/assets", 4),
    Ask("GET /v1/assets", "GET /v1/assets", 4, who="root"),
    Ask("GET /v1/assets/{asset_id}", "GET /v1/assets/{asset}", 4),
    Ask("GET /v1/assets/{asset_id}/content", "GET /v1/assets/{asset}/content", 6),
    Ask("GET /v1/assets/{asset_id}/frame", "GET /v1/assets/none/frame", 4),
    Ask("GET /v1/jobs", "GET /v1/jobs", 6),
    Ask("GET /v1/jobs", "GET /v1/jobs", 6, who="root"),
    Ask("GET /v1/jobs", "GET /v1/jobs", 6, who="cleo"),
    Ask("GET /v1/jobs", "GET /v1/jobs?state=failed", 4),
    Ask("GET /v1/jobs", "GET /v1/jobs?state=failed", 4, who="root"),
    Ask("GET /v1/jobs", "GET /v1/jobs?state=active", 6),
    Ask("GET /v1/jobs", "GET /v1/jobs?state=active", 6, who="root"),
    Ask("GET /v1/jobs", "GET /v1/jobs?state=succeeded", 6, who="root"),
    Ask("GET /v1/jobs", "GET /v1/jobs?state=running", 8, who="root"),
    Ask("GET /v1/jobs", "GET /v1/jobs?method=steady", 4),
    Ask("GET /v1/jobs", "GET /v1/jobs?method=steady", 4, who="root"),
    Ask("GET /v1/jobs", "GET /v1/jobs?method=multistyle&state=failed", 4, who="root"),
    Ask("GET /v1/jobs", "GET /v1/jobs?label=shot:7", 8, growth="linear"),
    Ask("GET /v1/jobs", "GET /v1/jobs?label=shot:none", 4),
    Ask("GET /v1/jobs", "GET /v1/jobs?search=multistyle", 6),
    Ask("GET /v1/jobs", "GET /v1/jobs?search=nowhere", 4, growth="linear"),
    Ask("GET /v1/jobs", "GET /v1/jobs?search=nowhere", 4, growth="linear", who="root"),
    Ask("GET /v1/jobs/{job_id}", "GET /v1/jobs/{job}", 6),
    Ask("GET /v1/jobs/{job_id}/tasks", "GET /v1/jobs/{job}/tasks", 10),
    Ask("GET /v1/jobs/{job_id}/events", "GET /v1/jobs/{job}/events", 20),
    Ask("GET /v1/jobs/{job_id}/files", "GET /v1/jobs/{job}/files", 30),
    Ask("GET /v1/jobs/{job_id}/files/{name}", "GET /v1/jobs/{job}/files/result", 12),
    Ask("GET /v1/jobs/{job_id}/result", "GET /v1/jobs/{job}/result", 12),
    Ask("GET /v1/jobs/{job_id}/poster", "GET /v1/jobs/{job}/poster", 12),
    Ask("GET /v1/jobs/{job_id}/sheet", "GET /v1/jobs/{job}/sheet", 12),
    Ask("GET /v1/jobs/{job_id}/preview", "GET /v1/jobs/{job}/preview", 12),
    Ask("GET /v1/jobs/{job_id}/exports", "GET /v1/jobs/{job}/exports", 12),
    Ask("GET /v1/jobs/{job_id}/webhooks", "GET /v1/jobs/{job}/webhooks", 8),
    Ask("GET /v1/jobs/{job_id}/artefacts/{name}", "GET /v1/jobs/{job}/artefacts/result", 12),
    Ask("GET /v1/jobs/{job_id}/artefacts/{name}/{entry:path}", "GET /v1/jobs/{job}/artefacts/result/0000.png", 12),
    Ask("GET /v1/jobs/{job_id}/frames/{index}", "GET /v1/jobs/{job}/frames/0", 12),
    Ask("GET /v1/jobs/{job_id}/queue", "GET /v1/jobs/{waiting}/queue", 25),
    Ask("GET /v1/jobs/{job_id}/queue", "GET /v1/jobs/{waiting}/queue", 17, who="root"),
    Ask("GET /v1/tasks/{task_id}", "GET /v1/tasks/{task}", 9),
    Ask("GET /v1/tasks/{task_id}/log", "GET /v1/tasks/{task}/log", 14),
    Ask("GET /v1/webhooks/secret", "GET /v1/webhooks/secret", 2),
    Ask("GET /v1/projects", "GET /v1/projects", 4),
    Ask("GET /v1/projects", "GET /v1/projects", 4, who="root"),
    Ask("GET /v1/projects/schema", "GET /v1/projects/schema", 2),
    Ask("GET /v1/projects/{project_id}", "GET /v1/projects/{project}", 8),
    Ask("GET /v1/projects/{project_id}/check", "GET /v1/projects/{project}/check", 10),
    Ask("GET /v1/projects/{project_id}/export", "GET /v1/projects/{project}/export", 14),
    Ask("GET /v1/projects/{project_id}/versions", "GET /v1/projects/{project}/versions", 7),
    Ask("GET /v1/projects/{project_id}/versions/{version}", "GET /v1/projects/{project}/versions/1", 7),
    Ask("GET /v1/projects/{project_id}/jobs", "GET /v1/projects/{project}/jobs", 10),
    Ask("GET /v1/projects/{project_id}/film", "GET /v1/projects/{project}/film", 24),
    Ask("GET /v1/projects/{project_id}/film/content", "GET /v1/projects/{project}/film/content", 24),
    Ask("GET /v1/projects/{project_id}/previews/state", "GET /v1/projects/{project}/previews/state", 4),
    Ask("GET /v1/shared/{token}", "GET /v1/shared/{token}", 12),
    Ask("GET /v1/shared/{token}/film", "GET /v1/shared/{token}/film", 60),
    Ask("GET /v1/shared/{token}/film/content", "GET /v1/shared/{token}/film/content", 60),
    Ask("GET /v1/shared/{token}/comments", "GET /v1/shared/{token}/comments", 12),
    Ask("GET /v1/projects/{project_id}/comments", "GET /v1/projects/{project}/comments", 6),
    Ask("GET /v1/shared/{token}/jobs", "GET /v1/shared/{token}/jobs", 14),
    Ask("GET /v1/shared/{token}/assets/{asset_id}/content", "GET /v1/shared/{token}/assets/{asset}/content", 14),
    Ask("GET /v1/shared/{token}/jobs/{job_id}/result", "GET /v1/shared/{token}/jobs/{job}/result", 20),
    Ask("GET /v1/live", "GET /v1/live", 2),
    Ask("GET /v1/keys", "GET /v1/keys", 4, who="root"),
    Ask("GET /v1/me", "GET /v1/me", 10, growth="linear"),
    Ask("GET /v1/groups/{group_id}/members", "GET /v1/groups/{group}/members", 7),
    Ask("GET /v1/ops/owners", "GET /v1/ops/owners", 4, who="root"),
    Ask("GET /v1/ops/audit", "GET /v1/ops/audit", 4, who="root"),
    Ask("GET /v1/ops/costs", "GET /v1/ops/costs", 4, growth="linear", who="root"),
    Ask("GET /v1/ops/costs", "GET /v1/ops/costs?by=shot", 4, growth="linear", who="root"),
    Ask("GET /v1/ops/retention", "GET /v1/ops/retention", 6, who="root"),
    Ask("GET /sign-in", "GET /sign-in", 0),
    Ask("GET /sign-in/callback", "GET /sign-in/callback", 0),
    Ask("GET /healthz", "GET /healthz", 0),
    Ask("GET /readyz", "GET /readyz", 2),
    Ask("GET /metrics", "GET /metrics", 13),
    Ask("GET /v1/ops/check", "GET /v1/ops/check", 24, growth="linear", who="root"),
    Ask("GET /v1/ops/snapshot", "GET /v1/ops/snapshot", 9, who="root"),
    Ask("GET /v1/ops/queue", "GET /v1/ops/queue", 4, who="root"),
    Ask("GET /v1/ops/workers", "GET /v1/ops/workers", 7, who="root"),
    Ask("GET /v1/ops/nodes", "GET /v1/ops/nodes", 8, who="root"),
    Ask("GET /v1/ops/failures", "GET /v1/ops/failures", 4, who="root"),
    Ask("GET /v1/ops/attempts/{attempt_id}/log", "GET /v1/ops/attempts/{attempt}/log", 4, who="root"),
    Ask("GET /v1/ops/jobs/{job_id}/timeline", "GET /v1/ops/jobs/{job}/timeline", 5, who="root"),
    Ask("GET /v1/ops/live", "GET /v1/ops/live", 4, who="root"),
    Ask("GET /v1/ops/machine", "GET /v1/ops/machine", 2, who="root"),
    Ask("GET /", "GET /", 0),
    Ask("GET /live", "GET /live", 0),
    Ask("GET /live/view", "GET /live/view", 0),
    Ask("GET /ops", "GET /ops", 0),
    Ask("GET /docs", "GET /docs", 0),
    Ask("GET /docs/shot", "GET /docs/shot", 0),
    Ask("GET /shared/{token}", "GET /shared/{token}", 0),
    Ask("GET /docs/{name}", "GET /docs/docs.css", 0),
)
"""Every route that only reads, by itself and with its filters."""
WRITES = (
    Ask(
        "POST /v1/estimates",
        "POST /v1/estimates",
        20,
        body={"request": {"method": "multistyle", "inputs": {"video": "{asset}"}}},
    ),
    Ask(
        "POST /v1/jobs", "POST /v1/jobs", 22, who="cleo", body={"method": "multistyle", "inputs": {"video": "{asset}"}}
    ),
    Ask("POST /v1/jobs/{job_id}/pause", "POST /v1/jobs/{first}/pause", 20),
    Ask("POST /v1/jobs/{job_id}/resume", "POST /v1/jobs/{first}/resume", 20),
    Ask("POST /v1/jobs/{job_id}/cancel", "POST /v1/jobs/{second}/cancel", 23),
    Ask("POST /v1/jobs/{job_id}/retry", "POST /v1/jobs/{second}/retry", 32, who="root"),
    Ask("DELETE /v1/jobs/{job_id}", "DELETE /v1/jobs/{old}", 25),
    Ask(
        "POST /v1/ops/jobs/{job_id}/priority",
        "POST /v1/ops/jobs/{first}/priority",
        16,
        growth="linear",
        who="root",
        body={"priority": None},
    ),
    Ask(
        "POST /v1/ops/jobs/actions",
        "POST /v1/ops/jobs/actions",
        51,
        who="root",
        body={"action": "delete", "jobs": "{several}"},
    ),
    Ask("POST /v1/projects", "POST /v1/projects", 10, "linear", body={"name": "x"}),
    Ask("POST /v1/projects/{project_id}/share", "POST /v1/projects/{project}/share", 8, body={}),
    Ask("POST /v1/keys", "POST /v1/keys", 11, who="root", body={"name": "new", "scopes": ["read"]}),
    Ask("POST /v1/ops/owners", "POST /v1/ops/owners", 6, who="root", body={"kind": "group", "name": "g"}),
    Ask(
        "POST /v1/ops/retention",
        "POST /v1/ops/retention?dry_run=true",
        6,
        growth="linear",
        who="root",
        body={"days": 30, "label": "shot"},
    ),
)
"""The main routes that write."""
UNMEASURED = frozenset({
    "POST /v1/styles/{style_id}/assets", "POST /v1/scenes/{name}/assets", "POST /v1/assets", "POST /v1/previews",
    "DELETE /v1/assets/{asset_id}", "OPTIONS /v1/uploads", "POST /v1/uploads", "PATCH /v1/uploads/{upload_id}",
    "DELETE /v1/uploads/{upload_id}", "POST /v1/tasks/{task_id}/requeue", "POST /v1/jobs/{job_id}/exports",
    "POST /v1/projects/import", "PUT /v1/projects/{project_id}", "PATCH /v1/projects/{project_id}",
    "DELETE /v1/projects/{project_id}", "POST /v1/projects/{project_id}/restore",
    "PUT /v1/projects/{project_id}/versions/{version}/label",
    "POST /v1/projects/{project_id}/versions/{version}/restore", "POST /v1/projects/{project_id}/jobs",
    "DELETE /v1/projects/{project_id}/share", "DELETE /v1/projects/{project_id}/comments/{comment_id}",
    "POST /v1/projects/{project_id}/comments", "POST /v1/shared/{token}/comments",
    "POST /v1/live/whip", "POST /v1/live/whep",
    "PUT /v1/groups/{group_id}/members/{user_id}", "DELETE /v1/groups/{group_id}/members/{user_id}",
    "PATCH /v1/ops/owners/{owner_id}", "POST /v1/ops/owners/{owner_id}/transfer",
    "DELETE /v1/ops/retention/{rule_id}", "POST /v1/ops/retention/apply", "POST /sign-out",
    "DELETE /v1/live/peers/{peer_id}", "DELETE /v1/keys/{key_id}", "POST /v1/keys/{key_id}/rotate",
    "GET /v1/ops/check/blobs",
    "POST /v1/ops/queue/pause",
    "POST /v1/ops/queue/resume", "POST /v1/ops/workers/{worker_id}/drain", "POST /v1/ops/workers/{worker_id}/resume",
    "POST /v1/ops/nodes/{node}/drain", "POST /v1/ops/nodes/{node}/resume", "POST /v1/ops/live/{session_id}/end",
    *(f"POST /v1/projects/{{project_id}}/previews/{what}" for what in (
        "propagate", "clusters", "spread", "object", "matte", "regions", "directions", "keys", "cuts", "flicker",
        "paint", "source", "styles")),
})  # fmt: skip
"""Routes whose cost is that of one file, document, picture or row; nothing of it depends on the number of jobs."""
