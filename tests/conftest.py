"""Fixtures that every part shares."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import pytest
import structlog

from . import s3_servers

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real and rendered captures with known answers, kept beside the checkout and never in it."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"needs the captures with known answers in {folder.relative_to(ROOT.parent)} beside the checkout")
    return folder


@pytest.fixture(autouse=True)
def log_as_found() -> Iterator[None]:
    """A command run inside a test sends the log to that test's standard error, which is gone in the next."""
    yield
    logger = logging.getLogger("microrelief")
    for handler in logger.handlers:
        handler.close()
    logger.handlers.clear()
    logger.propagate = True
    logger.setLevel(logging.NOTSET)
    structlog.reset_defaults()


@pytest.fixture(scope="session")
def s3_endpoint() -> Iterator[str]:
    """The address of an S3 server on this machine, with one empty bucket; one for all tests of a process."""
    with s3_servers.moto() as endpoint:
        s3_servers.client(endpoint).create_bucket(Bucket=s3_servers.BUCKET)
        yield endpoint


@pytest.fixture
def s3_prefix(s3_endpoint: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """A fresh ``s3://bucket/prefix``; the environment leads there."""
    monkeypatch.delenv("AWS_PROFILE", raising=False)
    for name, value in s3_servers.environment(s3_endpoint).items():
        monkeypatch.setenv(name, value)
    return f"s3://{s3_servers.BUCKET}/{uuid4().hex[:12]}"
