//! TLS to the broker: its certificate must come from a trusted authority, be for its name, and be valid now.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime, pem};
use rustls::{CertificateError, ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use swarmwright_sockets::Socket;

use crate::ConnectError;
use crate::settings::Settings;

/// The TLS handshake over a connected socket.
pub(crate) fn connect(
    settings: &Settings,
    stream: Socket,
) -> Result<StreamOwned<ClientConnection, Socket>, ConnectError> {
    let failed = |reason: String| ConnectError::Tls {
        url: settings.url.to_string(),
        reason,
    };
    let roots = authorities(settings).map_err(failed)?;
    let name = ServerName::try_from(settings.url.host.clone())
        .map_err(|error| failed(error.to_string()))?;
    let config =
        ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
            .with_safe_default_protocol_versions()
            .map_err(|error| failed(error.to_string()))?
            .with_root_certificates(roots)
            .with_no_client_auth();
    let connection =
        ClientConnection::new(Arc::new(config), name).map_err(|error| failed(error.to_string()))?;
    let mut stream = StreamOwned::new(connection, stream);
    while stream.conn.is_handshaking() {
        stream
            .conn
            .complete_io(&mut stream.sock)
            .map_err(|error| failed(explain(&error, settings)))?;
    }
    Ok(stream)
}

/// The authorities of `SWARMWRIGHT_CA_FILE`, or the system's.
fn authorities(settings: &Settings) -> Result<RootCertStore, String> {
    let mut roots = RootCertStore::empty();
    let Some(file) = &settings.ca_file else {
        roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
        return Ok(roots);
    };
    let unusable = |what: &dyn std::fmt::Display| {
        format!(
            "SWARMWRIGHT_CA_FILE {}: {what}; name the PEM file of the authority that signed the broker's certificate",
            file.display()
        )
    };
    let unreadable = |error: pem::Error| match error {
        pem::Error::Io(error) => unusable(&error),
        other => unusable(&other),
    };
    for certificate in CertificateDer::pem_file_iter(file).map_err(unreadable)? {
        roots
            .add(certificate.map_err(unreadable)?)
            .map_err(|error| unusable(&error))?;
    }
    if roots.is_empty() {
        return Err(unusable(&"there is no certificate in it"));
    }
    Ok(roots)
}

/// What is wrong with the certificate, and how to fix it.
fn explain(error: &io::Error, settings: &Settings) -> String {
    let Some(error) = error
        .get_ref()
        .and_then(|inner| inner.downcast_ref::<rustls::Error>())
    else {
        return format!("{error}; check scheme and port of the URL");
    };
    let host = &settings.url.host;
    match error {
        rustls::Error::InvalidCertificate(wrong) => match wrong {
            // A bad signature: an authority of the same name with another key.
            CertificateError::UnknownIssuer | CertificateError::BadSignature => match &settings.ca_file {
                Some(file) => format!(
                    "the broker's certificate is signed by an unknown authority, not by one in {}; \
                     name the right one with SWARMWRIGHT_CA_FILE",
                    file.display()
                ),
                None => "the broker's certificate is signed by an authority that is unknown to this system; name \
                         the authority's certificate with SWARMWRIGHT_CA_FILE"
                    .to_owned(),
            },
            CertificateError::NotValidForNameContext { presented, .. } => format!(
                "the broker's certificate is for {}, not for {host:?}; connect by one of these names, or have a \
                 certificate made for this one",
                hosts(presented)
            ),
            CertificateError::ExpiredContext { time, not_after } => format!(
                "the broker's certificate has expired, {} ago; renew it, or correct this machine's clock",
                days(*time, *not_after)
            ),
            CertificateError::NotValidYetContext { time, not_before } => format!(
                "the broker's certificate is not valid yet, only in {}; correct the clock of this machine or of the \
                 one where it was made",
                days(*not_before, *time)
            ),
            other => format!("the broker's certificate is refused: {other}"),
        },
        rustls::Error::InvalidMessage(_) => {
            "the server does not use TLS; check the port, or use mqtt:// or ws://"
                .to_owned()
        }
        other => other.to_string(),
    }
}

/// `DnsName("localhost")` and `IpAddress(127.0.0.1)` as people write them.
fn hosts(presented: &[String]) -> String {
    if presented.is_empty() {
        return "no host".to_owned();
    }
    let bare = |name: &String| {
        let inside = name
            .split_once('(')
            .map_or(name.as_str(), |(_, rest)| rest.trim_end_matches(')'));
        inside.trim_matches('"').to_owned()
    };
    presented.iter().map(bare).collect::<Vec<_>>().join(", ")
}

fn days(later: UnixTime, earlier: UnixTime) -> String {
    let span = Duration::from_secs(later.as_secs().saturating_sub(earlier.as_secs()));
    match span.as_secs() / 86_400 {
        0 => format!("{} minutes", span.as_secs() / 60),
        1 => "1 day".to_owned(),
        days => format!("{days} days"),
    }
}
