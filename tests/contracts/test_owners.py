"""Users, groups, costs, the audit trail and rules of deletion, with every database."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from pipeline.errors import BadParameter
from pipeline.methods.base import Task
from tests.contracts.databases import DATABASES
from workers.contract.order import CPU, TaskOutcome
from workers.contract.owners import AuditEntry, OwnerKind, RetentionRule, Role
from workers.contract.record import Asset
from workers.contract.request import JobRequest
from workers.errors import Conflict, NotFound
from workers.store import Accepted, Store

DAY_S = 86400.0


@pytest.fixture(params=DATABASES)
def store(request: pytest.FixtureRequest) -> Iterator[Store]:
    clock = [1000.0]
    store = Store(DATABASES[request.param](request, False), now=lambda: clock[0])
    store.clock = clock  # type: ignore[attr-defined]
    yield store
    store.close()


def _ended(store: Store, owner: str, cpu_s: float, **labels: str) -> str:
    """A job that has run one task."""
    store.assets.add(Asset("ast_a", "a", 3, "a.mp4", "video/mp4", "video", {}, 1.0, owner), lambda: True)
    request = JobRequest("toy", {"video": "ast_a"}, labels=labels)
    job = store.jobs.add(Accepted(request, {}, (("only", "Only"),)), owner).id
    store.plans.planned(job, 0, [Task("t")])
    claim = store.queue.claim("me", 1e9)
    assert claim is not None
    assert store.queue.finish(TaskOutcome(claim.attempt_id, {}, {}, {}, None, {CPU: cpu_s}, ""))
    return job


def test_costs_outlive_jobs_and_are_summed_by_owner_or_label(store: Store) -> None:
    jobs = [
        _ended(store, "anna", 2.0, show="heron"),
        _ended(store, "anna", 3.0),
        _ended(store, "ben", 4.0, show="heron"),
    ]
    store.costs.stored(jobs[0], 10)
    store.costs.stored(jobs[2], 5)
    store.jobs.remove(jobs[0])
    by_owner = [(cost.name, cost.jobs, cost.cpu_s, cost.bytes) for cost in store.costs.report()]
    assert by_owner == [("anna", 2, 5.0, 10), ("ben", 1, 4.0, 5)]
    assert [(cost.name, cost.cpu_s) for cost in store.costs.report("show")] == [("heron", 6.0), ("", 3.0)]
    assert store.costs.report(since=1001.0) == store.costs.report(until=1000.0) == []
    store.clock[0] += DAY_S  # type: ignore[attr-defined]
    assert store.costs.prune(2 * DAY_S) == 0 and store.costs.prune(DAY_S / 2) == 3


def test_rules_choose_ended_jobs_by_age_owner_and_label(store: Store) -> None:
    draft = _ended(store, "anna", 1.0, kind="draft")
    final, other = _ended(store, "anna", 1.0, kind="final"), _ended(store, "ben", 1.0, kind="draft")
    store.clock[0] += 5 * DAY_S  # type: ignore[attr-defined]
    due = store.retention.due
    assert due(RetentionRule(6)) == [] and due(RetentionRule(4)) == [draft, final, other]
    assert due(RetentionRule(4, owner="anna")) == [draft, final]
    assert due(RetentionRule(4, label="kind", value="draft")) == [draft, other]
    assert due(RetentionRule(4, "anna", "kind", "draft")) == [draft] and due(RetentionRule(4, label="other")) == []
    assert due(RetentionRule(4), after=draft, limit=1) == [final]
    with pytest.raises(BadParameter):
        store.retention.add(RetentionRule(4, value="draft"))
    made = store.retention.add(RetentionRule(4, label="kind"))
    assert store.retention.all() == [made]
    store.retention.remove(made.id)
    with pytest.raises(NotFound):
        store.retention.remove(made.id)


def test_a_group_has_members_with_roles(store: Store) -> None:
    anna, ben = (store.owners.add(name, OwnerKind.USER).id for name in ("anna", "ben"))
    group = store.owners.add("Show", OwnerKind.GROUP, {"active_jobs": 4}).id
    store.owners.put_member(group, anna, Role.VIEWER)
    store.owners.put_member(group, anna, Role.OWNER)
    assert store.owners.role(anna, group) == (Role.OWNER, {"active_jobs": 4})
    assert store.owners.role(ben, group) == (None, {"active_jobs": 4})
    assert store.owners.role(anna, ben) is None, "no group"
    assert [member.role for member in store.owners.members(group)] == [Role.OWNER]
    assert [each.group for each in store.owners.memberships(anna)] == [group]
    with pytest.raises(NotFound):
        store.keys.create("of a group", ["read"], owner=group)
    store.owners.change(group, disabled=True)
    assert store.owners.memberships(anna) == [] and store.owners.role(anna, group) is None
    store.owners.remove_member(group, anna)
    with pytest.raises(NotFound):
        store.owners.remove_member(group, anna)


def test_users_who_sign_in_are_known_by_their_subject(store: Store) -> None:
    first = store.owners.signed_in("https://login 1", "anna")
    assert store.owners.signed_in("https://login 1", "another name") == first
    other = store.owners.add("ben", OwnerKind.USER)
    with pytest.raises(Conflict):
        store.owners.link(other.id, "https://login 1")
    store.owners.link(other.id, "https://login 2")
    assert store.owners.signed_in("https://login 2", "ben").id == other.id


def test_everything_of_an_owner_moves_to_another(store: Store) -> None:
    old, new = (store.owners.add(name, OwnerKind.USER).id for name in ("old", "new"))
    job, own = _ended(store, old, 1.0), _ended(store, new, 2.0)
    assert store.owners.transfer(old, new) == {"jobs": 1, "deliveries": 0, "projects": 0, "job_costs": 1, "assets": 1}
    assert {each.id for each in store.jobs.page(owner=new).items} == {job, own}
    assert [cost.cpu_s for cost in store.costs.report()] == [3.0]
    assert store.assets.owners([old, new]) == {new}
    with pytest.raises(NotFound):
        store.owners.transfer(old, "usr_none")


def test_the_audit_trail_is_found_by_user_operation_and_object(store: Store) -> None:
    store.audit.add(AuditEntry("submit", "job_1", "anna", owner="grp_1"), AuditEntry("cancel", "job_1 job_10", "ben"))
    found = store.audit.page
    assert [entry.action for entry in found().items] == ["cancel", "submit"]
    assert [entry.action for entry in found("grp_1").items] == ["submit"]
    assert [entry.action for entry in found(about="job_10").items] == ["cancel"]
    assert [entry.action for entry in found(about="job_%").items] == []
    assert [entry.action for entry in found(action="submit").items] == ["submit"]
    page = found(limit=1)
    assert [entry.action for entry in found(cursor=page.cursor).items] == ["submit"]
    store.clock[0] += 10  # type: ignore[attr-defined]
    assert store.audit.prune(20) == 0 and store.audit.prune(5) == 2
