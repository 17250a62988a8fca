#!/usr/bin/env python3
"""Creates the bucket that IMPASTO_BLOB_URL names, if it does not exist, for S3 servers that start empty."""

from __future__ import annotations

import sys
import time
from typing import Any

from botocore.exceptions import BotoCoreError, ClientError

from service.settings import Settings
from workers.blobs.open import s3_options
from workers.blobs.s3_client import client_for

HERE_ALREADY = ("BucketAlreadyOwnedByYou", "BucketAlreadyExists")


def make_bucket(client: Any, name: str) -> str:
    """Create the bucket; returns what was done. Raises the errors of boto3."""
    try:
        client.create_bucket(Bucket=name)
    except ClientError as error:
        if error.response["Error"]["Code"] in HERE_ALREADY:
            return f"the bucket {name} already exists"
        raise
    return f"created the bucket {name}"


def main(tries: int = 30) -> int:
    settings = Settings()
    if not settings.blob_url:
        print("IMPASTO_BLOB_URL names no bucket", file=sys.stderr)
        return 2
    options = s3_options(settings)
    for _ in range(tries):
        try:
            print(make_bucket(client_for(options, hasty=True), options.bucket))
            return 0
        except (BotoCoreError, ClientError) as error:  # the server is still coming up
            print(error, file=sys.stderr)
            time.sleep(1)
    return 1


if __name__ == "__main__":
    sys.exit(main())
