"""Servers of the S3 protocol that are not ours: moto's, and s3rver, which ignores conditional writes."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
S3RVER = ROOT / ".cache" / "s3rver" / "node_modules" / "s3rver" / "bin" / "s3rver.js"
BUCKET = "microrelief-test"


def environment(endpoint: str, key: str = "test") -> dict[str, str]:
    """The variables that lead to a server, and to nothing that the machine's user has."""
    return {
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ACCESS_KEY_ID": key,
        "AWS_SECRET_ACCESS_KEY": key,
        "AWS_REGION": "us-east-1",
        "AWS_CONFIG_FILE": os.devnull,
        "AWS_SHARED_CREDENTIALS_FILE": os.devnull,
        "AWS_EC2_METADATA_DISABLED": "true",
        "NO_PROXY": "127.0.0.1",
    }


def client(endpoint: str, key: str = "test") -> Any:
    """A plain client, for what tests do behind our back."""
    import boto3
    from botocore.config import Config

    return boto3.session.Session().client(
        "s3",
        endpoint_url=endpoint,
        region_name="us-east-1",
        aws_access_key_id=key,
        aws_secret_access_key=key,
        config=Config(request_checksum_calculation="when_required", s3={"addressing_style": "path"}),
    )


@contextmanager
def moto() -> Iterator[str]:
    """Start moto's server; gives its address."""
    port = _free_port()
    with _running([sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)], port) as endpoint:
        yield endpoint


@contextmanager
def s3rver(folder: Path) -> Iterator[str]:
    """Start s3rver, or skip where it is not installed; gives its address."""
    node = shutil.which("node")
    if node is None or not S3RVER.exists():
        pytest.skip("needs s3rver, which `make setup-test` installs where there is npm")
    port = _free_port()
    options = ["--directory", str(folder), "--address", "127.0.0.1", "--port", str(port), "--silent"]
    with _running([node, str(S3RVER), *options], port) as endpoint:
        yield endpoint


@contextmanager
def _running(command: list[str], port: int) -> Iterator[str]:
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        try:
            for _ in range(600):
                with closing(socket.socket()) as probe:
                    if probe.connect_ex(("127.0.0.1", port)) == 0:
                        break
                assert server.poll() is None, f"{command} ended with {server.returncode}"
                time.sleep(0.1)  # until the other program listens
            yield f"http://127.0.0.1:{port}"
        finally:
            server.kill()


def _free_port() -> int:
    with closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
