"""/v1/ops: the audit trail, what jobs have cost, and rules that delete old jobs."""

from __future__ import annotations

import csv
import io
from dataclasses import astuple, dataclass, fields
from typing import Annotated, Any, Literal

from fastapi import Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from service.access.admission import Cost as RequestCost
from service.access.admission import costs
from service.access.audit import about
from service.context.depends import Admin, Context
from service.routing import Router
from service.schemas import ID, Cursor, Limit, Listing
from workers.contract.owners import AuditEntry, Cost, RetentionRule
from workers.farm_parts.retention import Due

router = Router(prefix="/v1/ops", tags=["ops"])

Seconds = Annotated[float, Query(ge=0, le=1e11, description="Seconds since the epoch.")]
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters of a text that spreadsheets run as a formula."""


@router.get("/audit")
@costs(RequestCost.HEAVY)
def list_audit(
    context: Context,
    _caller: Admin,
    who: Annotated[str | None, Query(max_length=80, description="A user, or the owner for whom it was done.")] = None,
    action: Annotated[str | None, Query(max_length=80, description="Name of an operation, as `create_key`.")] = None,
    about: Annotated[str | None, Query(max_length=100, description="Id of what was changed.")] = None,
    cursor: Cursor = None,
    limit: Limit = 50,
) -> Listing[AuditEntry]:
    """Who changed what, newest first: every operation that succeeded and changed something."""
    page = context.farm.audit.page(who, action, about, cursor, limit)
    return Listing(page.items, page.cursor)


@router.get(
    "/costs",
    response_model=Listing[Cost],
    responses={200: {"content": {"text/csv": {"schema": {"type": "string"}}}}},
)
@costs(RequestCost.HEAVY)
def get_costs(
    context: Context,
    _caller: Admin,
    by: Annotated[str, Query(max_length=80, description='"owner", or the name of a label.')] = "owner",
    since: Seconds = 0.0,
    until: Annotated[float | None, Query(ge=0, le=1e11, description="Seconds since the epoch; null: now.")] = None,
    format: Annotated[Literal["json", "csv"], Query(description="Of the answer.")] = "json",  # noqa: A002
) -> Any:
    """Costs of the jobs that ended in a period, including deleted ones: by owner, or by the value of a
    label. The dearest first."""
    found = context.farm.costs.report(by, since, until)
    return Listing(tuple(found), None) if format == "json" else Response(_csv(found), media_type="text/csv")


def _csv(found: list[Cost]) -> str:
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(field.name for field in fields(Cost))
    writer.writerows([f"'{name}" if name.startswith(_FORMULA) else name, *rest] for name, *rest in map(astuple, found))
    return text.getvalue()


class RuleIn(BaseModel):
    """Which jobs are deleted with their results."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    days: float = Field(ge=0, le=36500, description="Jobs that ended longer ago.")
    owner: str | None = Field(default=None, pattern=ID, description="Only jobs of this user or group.")
    label: str | None = Field(default=None, min_length=1, max_length=80, description="Only jobs with this label.")
    value: str | None = Field(default=None, max_length=255, description="Only jobs whose label has this value.")

    def rule(self) -> RetentionRule:
        return RetentionRule(self.days, self.owner, self.label, self.value)


@dataclass(frozen=True)
class RuleOut:
    rule: RetentionRule
    due: Due
    """What it deletes at the next sweep."""


@router.get("/retention")
@costs(RequestCost.HEAVY)
def list_rules(context: Context, _caller: Admin) -> Listing[RuleOut]:
    """The rules, and what each deletes at the next sweep (`IMPASTO_SWEEP_S`)."""
    retention = context.farm.retention
    return Listing(tuple(RuleOut(rule, retention.due(rule)) for rule in retention.rules()), None)


@router.post("/retention", status_code=201, responses={200: {"model": RuleOut, "description": "A dry run"}})
@costs(RequestCost.HEAVY)
def create_rule(
    body: RuleIn,
    request: Request,
    response: Response,
    context: Context,
    _caller: Admin,
    dry_run: Annotated[bool, Query(description="Only say what the rule would delete now.")] = False,
) -> RuleOut:
    """Create a rule that deletes old jobs with their results. 200 without a rule in a dry run."""
    retention, rule = context.farm.retention, body.rule()
    due = retention.due(rule)
    if dry_run:
        response.status_code = 200
    else:
        rule = retention.add(rule)
        about(request, rule.id)
    return RuleOut(rule, due)


@router.delete("/retention/{rule_id}", status_code=204)
def delete_rule(
    rule_id: Annotated[str, Path(pattern=ID, description="A rule's id.")], context: Context, _caller: Admin
) -> None:
    """Delete a rule. What it has deleted stays deleted."""
    context.farm.retention.remove(rule_id)


@router.post("/retention/apply")
@costs(RequestCost.READING)
def apply_rules(context: Context, _caller: Admin) -> Listing[str]:
    """Delete now what the rules fit, instead of at the next sweep. The items are the ids of the deleted jobs."""
    gone = context.farm.retention.apply()
    return Listing(tuple(gone), None)
