"""The objects of a bucket: what is asked of S3 beside what Icechunk asks, and with whose credentials.

Credentials, region and endpoint are botocore's to find (environment, profile, role of the machine) and are in no file
of ours; Icechunk gets the same ones, asked for when they are needed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from email.utils import parsedate_to_datetime
from functools import cache
from secrets import token_hex
from typing import Any
from urllib.parse import urlsplit

from configs import StoreError

__all__ = ["Found", "Objects", "PreconditionError"]

RENEW = timedelta(minutes=5)
"""Icechunk asks again for credentials that run out, this often."""


class PreconditionError(Exception):
    """A conditional write met another object than it expected, or one where it expected none."""


@dataclass(frozen=True, slots=True)
class Found:
    """An object: its bytes, its version, and its age by the server's own clock."""

    data: bytes
    etag: str
    age_s: float


@dataclass(frozen=True, slots=True)
class _Credentials:
    """What Icechunk asks for credentials; holds none itself, so that a session can be pickled."""

    def __call__(self) -> Any:
        import icechunk

        frozen = _session().get_credentials().get_frozen_credentials()
        until = datetime.now(UTC) + RENEW if frozen.token else None
        return icechunk.S3StaticCredentials(frozen.access_key, frozen.secret_key, frozen.token, until)


class Objects:
    """A bucket; errors name it by `url`.

    Raises
    ------
    StoreError
        From every method: one line that says what S3 answered and what to do.
    """

    def __init__(self, bucket: str, url: str) -> None:
        from botocore.config import Config

        self._bucket, self._url = bucket, url
        session = _session()
        if session.get_credentials() is None:
            raise StoreError(
                f"{self._url}: no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"
            )
        config = Config(
            connect_timeout=10,
            read_timeout=60,
            retries={"mode": "standard", "max_attempts": 4},
            # servers that are not Amazon's know neither its newer checksums nor a name for each bucket
            request_checksum_calculation="when_required",
            response_checksum_validation="when_required",
        )
        self._region = os.environ.get("AWS_REGION") or session.get_config_variable("region")
        client = session.create_client("s3", region_name=self._region or "us-east-1", config=config)
        endpoint = client.meta.endpoint_url
        self._endpoint = None if (urlsplit(endpoint).hostname or "").endswith("amazonaws.com") else endpoint
        if self._endpoint is not None:
            style = Config(s3={"addressing_style": "path"})
            client = session.create_client("s3", region_name=self._region or "us-east-1", config=config.merge(style))
        self._client = client

    def storage(self, prefix: str) -> Any:
        """Give Icechunk's way to a prefix."""
        import icechunk

        return icechunk.s3_storage(
            bucket=self._bucket,
            prefix=prefix,
            region=self._region or self._region_of_bucket(),
            endpoint_url=self._endpoint,
            allow_http=self._endpoint is not None and self._endpoint.startswith("http://"),
            force_path_style=self._endpoint is not None,
            get_credentials=_Credentials(),
        )

    def get(self, key: str) -> Found | None:
        """Read an object; None where there is none."""
        with self._told():
            try:
                answer = self._client.get_object(Bucket=self._bucket, Key=key)
                data = answer["Body"].read()
            except self._client.exceptions.NoSuchKey:
                return None
        now = answer["ResponseMetadata"]["HTTPHeaders"].get("date")
        age = (parsedate_to_datetime(now) - answer["LastModified"]).total_seconds() if now else 0.0
        return Found(data, answer["ETag"], age)

    def put(self, key: str, data: bytes, *, replacing: str | None) -> str:
        """Write an object where there is none, or in the place of the version `replacing`; give the new version.

        Raises
        ------
        PreconditionError
            If there is another.
        """
        from botocore.exceptions import ClientError

        condition = {"IfNoneMatch": "*"} if replacing is None else {"IfMatch": replacing}
        with self._told():
            try:
                return str(self._client.put_object(Bucket=self._bucket, Key=key, Body=data, **condition)["ETag"])
            except ClientError as error:
                # 409: another conditional write was under way; 404: what was to be replaced is gone
                if error.response["ResponseMetadata"]["HTTPStatusCode"] in (404, 409, 412) and _code(error) not in (
                    "NoSuchBucket",
                ):
                    raise PreconditionError(key) from None
                raise

    def below(self, prefix: str) -> Iterator[tuple[str, int]]:
        """Give the key, less `prefix`, and the size of every object whose key begins with it."""
        with self._told():
            pages = self._client.get_paginator("list_objects_v2").paginate(Bucket=self._bucket, Prefix=prefix)
            for page in pages:
                for item in page.get("Contents", ()):
                    yield item["Key"].removeprefix(prefix), int(item["Size"])

    def prove_conditions(self, prefix: str) -> None:
        """Try on the bucket itself that conditional writes hold: two that must be taken, two that must be refused.

        `prefix` begins the key of the object that is written and deleted.

        Raises
        ------
        StoreError
            If the server takes what it must refuse: on it two writers could destroy each other's scans.
        """
        key = f"{prefix}{token_hex(8)}"
        try:
            first = self.put(key, b"first", replacing=None)
            ignored = [
                header
                for header, version in (("If-None-Match", None), ("If-Match", '"00000000000000000000000000000000"'))
                if self._takes(key, version)
            ]
            if ignored:
                raise StoreError(
                    f"{self._url}: this server ignores conditional writes ({' and '.join(ignored)}: it took a write "
                    "that it had to refuse), so two writers could destroy each other's scans: use another server, or a "
                    "local folder"
                )
            self.put(key, b"second", replacing=first)
        except PreconditionError:
            raise StoreError(
                f"{self._url}: this server refuses conditional writes that it had to take: use another server, or a "
                "local folder"
            ) from None
        finally:
            with self._told():
                self._client.delete_object(Bucket=self._bucket, Key=key)

    def close(self) -> None:
        """Close the connections."""
        self._client.close()

    def _takes(self, key: str, replacing: str | None) -> bool:
        try:
            self.put(key, b"never", replacing=replacing)
        except PreconditionError:
            return False
        return True

    def _region_of_bucket(self) -> str:
        with self._told():
            return str(self._client.head_bucket(Bucket=self._bucket).get("BucketRegion") or "us-east-1")

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Say in one line what S3 refused and what to do."""
        from botocore import exceptions as refusal

        try:
            yield
        except refusal.ClientError as error:
            code = _code(error)
            status = error.response["ResponseMetadata"].get("HTTPStatusCode")
            if code in ("NoSuchBucket", "404"):
                text = f"there is no bucket {self._bucket}: make it first, or check the name and AWS_ENDPOINT_URL"
            elif status in (401, 403) or code in ("InvalidAccessKeyId", "SignatureDoesNotMatch"):
                text = f"access denied ({code}): check the credentials and what they may do in this bucket"
            else:
                text = f"S3 answered {code}: {error.response['Error'].get('Message', '')}".rstrip(": ")
            raise StoreError(f"{self._url}: {text}") from None
        except (refusal.ConnectionError, refusal.HTTPClientError):
            text = f"{self._endpoint or 'Amazon S3'} cannot be reached: check the network and AWS_ENDPOINT_URL"
            raise StoreError(f"{self._url}: {text}") from None
        except refusal.BotoCoreError as error:
            raise StoreError(f"{self._url}: {str(error).splitlines()[0]}") from None


def _session() -> Any:
    """Give a session of botocore, which finds the credentials anew."""
    try:
        from botocore import session as sessions
    except ImportError:
        raise StoreError("stores on S3 need botocore: `pip install 'microrelief[s3]'`") from None
    from botocore.exceptions import BotoCoreError

    session = sessions.get_session()
    try:
        session.register_component("data_loader", _loader(session.get_config_variable("data_path")))
    except BotoCoreError as error:  # a profile that is not there
        raise StoreError(f"credentials for S3: {str(error).splitlines()[0]}: check AWS_PROFILE") from None
    return session


@cache
def _loader(data_path: str | None) -> Any:
    """Read botocore's description of S3 once: to read it for every session took most of the time of opening a store."""
    from botocore.loaders import create_loader

    return create_loader(data_path)


def _code(error: Any) -> str:
    return str(error.response.get("Error", {}).get("Code", "")) or "an error"
