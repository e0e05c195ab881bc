"""Checks of a broker's certificate."""

import ssl
from pathlib import Path

_END = "-----END CERTIFICATE-----"


def is_authority_certificate(file: Path) -> bool:
    """Whether the first certificate of a PEM file belongs to an authority (CA:TRUE).

    TLS clients may refuse a broker that presents such a certificate. False for files that are not PEM.
    """
    try:
        first, end, _ = file.read_text(encoding="ascii").partition(_END)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(cadata=first + end)
    except (OSError, ValueError):  # ssl.SSLError is an OSError
        return False
    return context.cert_store_stats()["x509_ca"] > 0
