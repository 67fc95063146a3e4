"""Roles on the bus: what each participant may say, and how Zenoh's access control enforces it.

Peers talk to each other directly, so each one judges for itself: what comes in (`ingress`) by the name in the
certificate of who sends it, and what it sends itself (`egress`). The receiver's judgement is the one that counts.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

from das.bus.topics import TOPICS


class Role(StrEnum):
    """What a process on the bus is."""

    SIMULATOR = "simulator"
    NODE = "node"
    RECORDER = "recorder"
    CAB = "cab"
    DRIVER = "driver"


HEARING = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
SAYING = ["put", "reply", "declare_queryable", "liveliness_token"]
"""Zenoh's messages of who hears and of who says; a latched topic is asked for and answered as well. No delete."""


def common_name(role: Role, train: str) -> str:
    """The name in a certificate."""
    return f"{role}.{train}"


def keys_of(role: Role, train: str) -> list[str]:
    """Keys a role publishes. The simulator stands for all of the world: localisation, operator, the train itself."""
    said_by_us = (Role.NODE, Role.RECORDER, Role.DRIVER)
    own = [
        topic
        for topic in TOPICS
        if topic.publisher == role or (role is Role.SIMULATOR and topic.publisher not in said_by_us)
    ]
    # A latched topic's history is found and fetched under keys of its own; `**` does not match them.
    return [key for t in own for key in (t.key(train), *([f"{t.key(train)}/@adv/**"] if t.latched else []))]


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
