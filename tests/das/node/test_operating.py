"""The operator's page: the commands of its unit and container file start a node, which its health check finds."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import das.domain.catalogue
from das.bus.session import endpoint, free_ports
from tests.support.making import REPOSITORY
from tests.support.needs import missing
from tests.support.node_process import process

EXAMPLES = REPOSITORY / "docs" / "examples"
CATALOGUE = Path(das.domain.catalogue.__path__[0])
MOST_MB = 400
"""Most memory of a node that has started on a short line."""


def unit() -> list[str]:
    (words,) = re.findall(r"^ExecStart=(.*)$", (EXAMPLES / "das-node.service").read_text(), re.MULTILINE)
    return words.split()


def container() -> list[str]:
    (words,) = re.findall(r"^ENTRYPOINT (.*)$", (EXAMPLES / "Containerfile").read_text(), re.MULTILINE)
    return list(json.loads(words))


def health(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLES / "node_health.py"), *words]
    return subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.slow
def test_unit_and_container_have_one_command_which_starts_a_healthy_node(tmp_path: Path) -> None:
    program, *words = unit()
    assert Path(program).name == container()[0] == "das-node"
    assert words == container()[1:]
    shutil.copy(CATALOGUE / "routes" / "flat-6km.toml", tmp_path / "line.toml")
    shutil.copy(CATALOGUE / "vehicles" / "re460-ic.toml", tmp_path / "train.toml")
    (tmp_path / "tables").mkdir()
    here, there = (endpoint(port) for port in free_ports(2))
    places = {"/etc/das": str(tmp_path), "/var/lib/das": str(tmp_path)}
    places |= {"tcp/127.0.0.1:7447": here, "tcp/127.0.0.1:7448": there}
    for old, new in places.items():
        words = [word.replace(old, new) for word in words]
    with process("das.node", *words) as node:
        assert node.stdout is not None
        while "listening on" not in (line := node.stdout.readline()):
            assert line, "the node ended"
        found = health("IC1", here)
        assert found.returncode == 0
        assert found.stdout.startswith("STATE_WAITING ")
        status = Path(f"/proc/{node.pid}/status").read_text()
        assert int(re.findall(r"VmHWM:\s+(\d+) kB", status)[0]) / 1000 < MOST_MB
    assert health("IC1", here).returncode == 1


def test_the_container_file_names_what_the_checkout_has() -> None:
    """No engine builds the image here, so its Python, its script and its folders are compared with the project."""
    text, project = (EXAMPLES / "Containerfile").read_text(), tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    (minor,) = re.findall(r"^FROM python:3\.(\d+)-slim$", text, re.MULTILINE)
    (least,) = re.findall(r"^>=3\.(\d+)$", project["project"]["requires-python"])
    assert int(minor) >= int(least)
    assert container()[0] in project["project"]["scripts"]
    (check,) = re.findall(r"CMD (\[.*\])$", text, re.MULTILINE)
    assert (REPOSITORY / Path(json.loads(check)[1]).relative_to("/src")).is_file()
    (volumes,) = re.findall(r"^VOLUME (.*)$", text, re.MULTILINE)
    (cache,) = re.findall(r"^ENV NUMBA_CACHE_DIR=(.*)$", text, re.MULTILINE)
    for path in (cache, *(word for word in container() if word.startswith("/"))):
        assert any(Path(path).is_relative_to(volume) for volume in volumes.split()), path


def test_the_unit_is_one_that_systemd_reads(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        missing("systemd-analyze is missing: apt-get install systemd")
    text = (EXAMPLES / "das-node.service").read_text().replace("/opt/das/bin/das-node", sys.executable)
    (tmp_path / "das-node.service").write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", tmp_path / "das-node.service"], capture_output=True, text=True, check=False
    )
    assert "das-node.service" not in done.stderr, done.stderr
