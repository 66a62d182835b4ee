"""A cluster's protocol runs what it is sent: who may answer at an address is decided before anything is sent there."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from studies.blind_trial.__main__ import STUDY
from studies.blind_trial.cluster import Cluster, cluster_of, connect
from studies.blind_trial.options import TrialOptions
from studies.command import BAD_INPUT, main
from studies.options import BadInputError

REFUSED = (
    (["--scheduler", "tcp://10.0.0.7:8786"], "whoever answers there without TLS can run code here"),
    (["--scheduler", "10.0.0.7:8786"], "whoever answers there without TLS"),
    (["--scheduler", "tcp://cluster:8786"], "whoever answers there without TLS"),
    (["--scheduler", "tcp://127.0.0.1.evil.example:8786"], "whoever answers there without TLS"),
    (["--scheduler", "tcp://localhost.evil.example:8786"], "whoever answers there without TLS"),
    (["--scheduler", "tcp://[2001:db8::1]:8786"], "whoever answers there without TLS"),
    (["--scheduler", "tcp://0.0.0.0:8786"], "whoever answers there without TLS"),
    (["--scheduler", "tcp://127.0.0.1@evil.example:8786"], "is not an address"),
    (["--scheduler", "tcp://127.0.0.1"], "is not an address"),
    (["--scheduler", "tcp://127.0.0.1:99999"], "is not an address"),
    (["--scheduler", "tcp://[::1:8786"], "is not an address"),
    (["--scheduler", "ws://127.0.0.1:8786"], "is not an address"),
    (["--scheduler", "inproc://1/2/3"], "is not an address"),
    (["--scheduler", ""], "is not an address"),
    (["--scheduler", "tls://cluster:8786"], "--tls-ca: is missing"),
    (["--scheduler", "tls://cluster:8786", "--insecure-scheduler"], "--tls-ca: is missing"),
    (["--scheduler", "tls://cluster:8786", "--tls-ca", "nowhere.pem"], "--tls-ca: nowhere.pem is not a file"),
    (["--scheduler", "tcp://127.0.0.1:8786", "--tls-ca", "ca.pem"], "--tls-ca: is for tls://"),
    (["--tls-key", "key.pem"], "--tls-key: is for a --scheduler"),
    (["--insecure-scheduler"], "--insecure-scheduler: is for a --scheduler"),
)


@pytest.mark.parametrize(("arguments", "said"), REFUSED)
def test_an_address_that_is_not_trusted_is_refused_before_the_work(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("studies.blind_trial.compute.seal", lambda *_: pytest.fail("the work has begun"))
    assert main(STUDY, ["--quick", "--output", str(tmp_path), *arguments]) == BAD_INPUT
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert said in errors[0]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "127.0.0.1:8786", "tcp://localhost:1", "tcp://[::1]:8786"])
def test_this_computer_needs_no_certificate(address: str) -> None:
    assert cluster_of(TrialOptions(scheduler=address)) == Cluster(address)


def test_another_one_can_be_insisted_on() -> None:
    there = TrialOptions(scheduler="tcp://cluster:8786", insecure_scheduler=True)
    assert cluster_of(there) == Cluster("tcp://cluster:8786")
    assert cluster_of(TrialOptions()) is None


def test_no_scheduler_is_one_sentence() -> None:
    with pytest.raises(BadInputError, match="no Dask scheduler"):
        connect(Cluster("tcp://127.0.0.1:1"))


def authority(folder: Path, name: str) -> tuple[Path, Path, Path]:
    """A self-signed certificate, which is its own authority, and its key."""
    certificate, key = folder / f"{name}.pem", folder / f"{name}-key.pem"
    words = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    words += ["-days", "2", "-subj", f"/CN={name}", "-keyout", str(key), "-out", str(certificate)]
    subprocess.run(words, check=True, capture_output=True)
    return certificate, certificate, key


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates")
def test_a_cluster_is_reached_by_its_certificates_and_by_no_others(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    ca, certificate, key = authority(tmp_path, "ours")
    security = distributed.Security(
        tls_ca_file=str(ca),
        tls_client_cert=str(certificate),
        tls_client_key=str(key),
        tls_scheduler_cert=str(certificate),
        tls_scheduler_key=str(key),
        tls_worker_cert=str(certificate),
        tls_worker_key=str(key),
        require_encryption=True,
    )
    with distributed.LocalCluster(
        n_workers=1, processes=False, dashboard_address=None, silence_logs=50, security=security, protocol="tls://"
    ) as one:
        address = one.scheduler_address
        assert address.startswith("tls://")
        options = TrialOptions(scheduler=address, tls_ca=ca, tls_cert=certificate, tls_key=key)
        cluster = cluster_of(options)
        assert cluster is not None
        with connect(cluster) as client:
            assert client.submit(sum, [1, 2]).result(timeout=10) == 3
        with pytest.raises(BadInputError, match="--scheduler tls://"):
            connect(Cluster(address, authority(tmp_path, "others")))
