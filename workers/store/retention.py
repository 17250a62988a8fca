"""Rules that delete old jobs, and the jobs that a rule deletes."""

from __future__ import annotations

from dataclasses import replace

from sqlalchemy import delete, insert, select

from pipeline.errors import BadParameter
from workers.contract.owners import RetentionRule
from workers.contract.record import RunState
from workers.errors import NotFound
from workers.ids import new_id
from workers.store import schema
from workers.store.base import StorePart

DAY_S = 86400.0
_FINAL = [state.value for state in RunState if state.final]


class RetentionRules(StorePart):
    """Rules by id."""

    def all(self) -> list[RetentionRule]:
        """Oldest first."""
        table = schema.retention_rules
        with self._db.read() as connection:
            return [RetentionRule(**row) for row in connection.execute(select(table).order_by(table.c.id)).mappings()]

    def add(self, rule: RetentionRule) -> RetentionRule:
        """Raises BadParameter: a value without a label."""
        made = replace(_checked(rule), id=new_id("rul_"), created_at=self._now())
        with self._db.write() as connection:
            connection.execute(insert(schema.retention_rules).values(vars(made)))
        return made

    def remove(self, rule_id: str) -> None:
        """Raises NotFound."""
        table = schema.retention_rules
        with self._db.write() as connection:
            if not connection.execute(delete(table).where(table.c.id == rule_id)).rowcount:
                raise NotFound(f"There is no rule {rule_id}.", field="rule_id", value=rule_id, remedy="List the rules.")

    def due(self, rule: RetentionRule, after: str = "", limit: int = 1000) -> list[str]:
        """Ids of jobs that the rule deletes now, in order, beginning behind `after`. Raises BadParameter."""
        _checked(rule)
        jobs, labels = schema.jobs, schema.job_labels
        past = self._now() - rule.days * DAY_S
        query = select(jobs.c.id).where(jobs.c.state.in_(_FINAL), jobs.c.finished_at < past, jobs.c.id > after)
        if rule.owner is not None:
            query = query.where(jobs.c.owner == rule.owner)
        if rule.label is not None:
            named = select(labels.c.job_id).where(labels.c.name == rule.label)
            if rule.value is not None:
                named = named.where(labels.c.value == rule.value)
            query = query.where(jobs.c.id.in_(named))
        with self._db.read() as connection:
            return list(connection.execute(query.order_by(jobs.c.id).limit(limit)).scalars())


def _checked(rule: RetentionRule) -> RetentionRule:
    if rule.value is not None and rule.label is None:
        raise BadParameter("A value is one of a label.", field="value", value=rule.value, remedy="Name the label, too.")
    if not rule.days >= 0:
        raise BadParameter("An age is not negative.", field="days", value=rule.days)
    return rule
