"""The Dask cluster that may answer a trial's cases, and how it is reached.

Dask's protocol is pickle without authentication: whoever answers at the address runs code here. So it is reached over
TLS with certificates on both sides, or without on this computer only, unless the user insists.
"""

from __future__ import annotations

import ipaddress
import ssl
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from studies.blind_trial.options import TrialOptions
from studies.options import BadInputError


@dataclass(frozen=True)
class Cluster:
    """A scheduler's address; for tls:// the files of the authority's certificate, one's own and its key."""

    address: str
    certificates: tuple[Path, Path, Path] | None = None


def cluster_of(options: TrialOptions) -> Cluster | None:
    """The cluster that the options ask for, if any. Raises BadInputError for one that must not be connected to."""
    files = {"--tls-ca": options.tls_ca, "--tls-cert": options.tls_cert, "--tls-key": options.tls_key}
    given = [name for name, file in files.items() if file is not None]
    if options.scheduler is None:
        if given or options.insecure_scheduler:
            name = given[0] if given else "--insecure-scheduler"
            raise BadInputError(f"{name}: is for a --scheduler; give its address too, or leave it out")
        return None
    scheme, host = _parts(options.scheduler)
    if scheme == "tcp":
        if given:
            raise BadInputError(
                f"{given[0]}: is for tls:// and --scheduler is {options.scheduler}; give tls://host:port"
            )
        if not (options.insecure_scheduler or is_loopback(host)):
            raise BadInputError(
                f"--scheduler {options.scheduler}: whoever answers there without TLS can run code here; give tls:// "
                "with --tls-ca, --tls-cert and --tls-key, or insist with --insecure-scheduler"
            )
        return Cluster(options.scheduler)
    for name, file in files.items():
        if file is None or not file.is_file():
            said = "is missing" if file is None else f"{file} is not a file"
            raise BadInputError(f"{name}: {said}; tls:// needs the PEM files of --tls-ca, --tls-cert and --tls-key")
    assert options.tls_ca is not None
    assert options.tls_cert is not None
    assert options.tls_key is not None
    return Cluster(options.scheduler, (options.tls_ca, options.tls_cert, options.tls_key))


def _parts(address: str) -> tuple[str, str]:
    """Scheme and host of an address; without a scheme it is plain TCP, as Dask reads it. Raises BadInputError."""
    whole = address if "://" in address else f"tcp://{address}"
    try:
        parts = urlsplit(whole)
        host, port = parts.hostname, parts.port
    except ValueError:
        parts, host, port = urlsplit(""), None, None
    if parts.scheme not in {"tcp", "tls"} or not host or port is None or parts.username or parts.path:
        raise BadInputError(f"--scheduler {address}: is not an address; give tls://host:port or tcp://127.0.0.1:port")
    return parts.scheme, host


def is_loopback(host: str) -> bool:
    """Whether a host is this computer itself, whatever its name server says."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def connect(cluster: Cluster) -> Any:
    """A client of the cluster. Raises BadInputError where no scheduler answers."""
    distributed = import_module("distributed")
    try:
        security = None
        if cluster.certificates is not None:
            ca, certificate, key = map(str, cluster.certificates)
            security = distributed.Security(
                tls_ca_file=ca, tls_client_cert=certificate, tls_client_key=key, require_encryption=True
            )
        return distributed.Client(cluster.address, timeout=5, security=security)
    except ssl.SSLError as error:
        raise BadInputError(
            f"--scheduler {cluster.address}: the certificates can't be used ({error.reason or error}); "
            "give PEM files of one authority"
        ) from error
    except (OSError, ValueError) as error:
        raise BadInputError(
            f"--scheduler {cluster.address}: no Dask scheduler answers there; start one, or leave it out"
        ) from error
