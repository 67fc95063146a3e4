"""Roles on the bus: what each participant may say, and how Zenoh's access control enforces it.

Peers talk to each other directly, so each one judges for itself: what comes in (`ingress`) by the name in the
certificate of who sends it, and what it sends itself (`egress`). The receiver's judgement is the one that counts.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any, Final

from das.bus.topics import TOPICS


class Role(StrEnum):
    """What a process on the bus is."""

    SIMULATOR = "simulator"
    """All of the world at once: sensors, operator, and what only a simulation says."""
    SENSORS = "sensors"
    """Localisation and train control: where the train is, and its forces."""
    OPERATOR = "operator"
    """The ground: journey, restrictions, targets and delay."""
    NODE = "node"
    RECORDER = "recorder"
    CAB = "cab"
    """A listener, which says nothing."""
    DRIVER = "driver"


PUBLISHERS: Final = {Role.SENSORS: ("localisation", "train control")}
"""The publishers in the registry of topics that a role stands for, where they are not named as the role is."""
HEARING = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
SAYING = ["put", "reply", "declare_queryable", "liveliness_token"]
"""Zenoh's messages of who hears and of who says; a latched topic is asked for and answered as well. No delete."""


def common_name(role: Role, train: str) -> str:
    """The name in a certificate."""
    return f"{role}.{train}"


def keys_of(role: Role, train: str) -> list[str]:
    """Keys a role publishes. The simulator stands for all of the world: localisation, operator, the train itself."""
    own = [topic for topic in TOPICS if _may_say(role, topic.publisher)]
    # A latched topic's history is found and fetched under keys of its own; `**` does not match them.
    return [key for t in own for key in (t.key(train), *([f"{t.key(train)}/@adv/**"] if t.latched else []))]


def _may_say(role: Role, publisher: str) -> bool:
    if role is Role.SIMULATOR:
        return publisher not in (Role.NODE, Role.RECORDER, Role.DRIVER)
    return publisher in PUBLISHERS.get(role, (role,))


def access_control(own: Role, train: str) -> dict[str, Any]:
    """Zenoh's `access_control` for a process: denied is what no rule allows."""
    roots = sorted({topic.root for topic in TOPICS})
    heard = [f"{root}/{train}/{rest}" for root in (*roots, "*") for rest in ("*", "*/@adv/**")]
    rules = [_rule("hear", ["ingress", "egress"], HEARING, heard)]
    policies = []
    for role in Role:
        names = ["hear"]
        if keys := keys_of(role, train):
            rules.append(_rule(f"from-{role}", ["ingress"], SAYING, keys))
            names.append(f"from-{role}")
        if keys_of(own, train):
            names.append("own")
        policies.append({"id": role, "rules": names, "subjects": [role]})
    if keys := keys_of(own, train):
        rules.append(_rule("own", ["egress"], SAYING, keys))
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": role, "cert_common_names": [common_name(role, train)]} for role in Role],
        "policies": policies,
    }


def _rule(name: str, flows: list[str], messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}
