"""The certificate that a broker listens with."""

from pathlib import Path

import pytest

from swarmwright import _engine
from swarmwright.servers.broker.mosquitto import is_authority_certificate


def test_a_certificate_of_an_authority_is_told_from_one_that_it_signed(tmp_path: Path) -> None:
    authority, _, certificate, _ = _engine.certificates(["localhost"], 2)
    chain = tmp_path / "chain.pem"
    chain.write_text(certificate + authority)
    assert not is_authority_certificate(chain)
    chain.write_text(authority)
    assert is_authority_certificate(chain)


@pytest.mark.parametrize("content", [b"", b"-----BEGIN CERTIFICATE-----\nAAAA", b"\xff\xfe"])
def test_what_is_not_pem_is_not_judged(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "chain.pem"
    file.write_bytes(content)
    assert not is_authority_certificate(file)
    assert not is_authority_certificate(tmp_path / "none.pem")
