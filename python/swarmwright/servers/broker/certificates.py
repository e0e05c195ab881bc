"""The certificate that a broker listens with."""

import ssl
from pathlib import Path

_END = "-----END CERTIFICATE-----"


def is_of_authority(file: Path) -> bool:
    """Whether the first certificate of a PEM file is that of an authority (CA:TRUE).

    Clients of TLS may refuse a broker that presents one. False for a file that cannot be read as PEM.
    """
    try:
        first, found, _ = file.read_text(encoding="ascii").partition(_END)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(cadata=first + found)
    except (OSError, ValueError):  # ssl.SSLError is an OSError
        return False
    return context.cert_store_stats()["x509_ca"] > 0
