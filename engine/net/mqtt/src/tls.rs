//! TLS to the broker, whose certificate must be signed by a trusted authority, match its host name, and be valid now.
//! Some brokers require a client certificate, too.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime, pem};
use rustls::sign::{CertifiedKey, SingleCertAndKey};
use rustls::{
    AlertDescription, CertificateError, ClientConfig, ClientConnection, InconsistentKeys,
    OtherError, RootCertStore, StreamOwned,
};
use swarmwright_sockets::Socket;

use crate::ConnectError;
use crate::settings::{ClientCertificate, Settings};

/// Performs the TLS handshake over a connected socket.
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
    let verifying =
        ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
            .with_safe_default_protocol_versions()
            .map_err(|error| failed(error.to_string()))?
            .with_root_certificates(roots);
    let config = match &settings.certificate {
        None => verifying.with_no_client_auth(),
        Some(files) => {
            let certified = identity(files).map_err(failed)?;
            verifying.with_client_cert_resolver(Arc::new(SingleCertAndKey::from(certified)))
        }
    };
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

/// Returns the authorities in `SWARMWRIGHT_CA_FILE`, or those of the system.
fn authorities(settings: &Settings) -> Result<RootCertStore, String> {
    let mut roots = RootCertStore::empty();
    let Some(file) = &settings.ca_file else {
        roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
        return Ok(roots);
    };
    let unusable = |problem: &dyn std::fmt::Display| {
        format!(
            "SWARMWRIGHT_CA_FILE {}: {problem}; name the PEM file of the authority that signed the broker's certificate",
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
        return Err(unusable(&"it contains no certificate"));
    }
    Ok(roots)
}

/// Returns the client's certificate chain and its key.
fn identity(files: &ClientCertificate) -> Result<CertifiedKey, String> {
    let unusable = |variable: &str, file: &Path, error: pem::Error, expected: &str| {
        let problem = match error {
            pem::Error::Io(error) => error.to_string(),
            pem::Error::NoItemsFound => format!("it contains no {expected}"),
            other => other.to_string(),
        };
        format!(
            "{variable} {}: {problem}; name a PEM file with the client's {expected}",
            file.display()
        )
    };
    let chain = CertificateDer::pem_file_iter(&files.chain)
        .and_then(Iterator::collect::<Result<Vec<_>, _>>)
        .and_then(|chain| match chain.is_empty() {
            true => Err(pem::Error::NoItemsFound),
            false => Ok(chain),
        })
        .map_err(|error| {
            unusable(
                "SWARMWRIGHT_CERTIFICATE_FILE",
                &files.chain,
                error,
                "certificate",
            )
        })?;
    let key = PrivateKeyDer::from_pem_file(&files.key).map_err(|error| {
        unusable(
            "SWARMWRIGHT_KEY_FILE",
            &files.key,
            error,
            "private key without a passphrase (`openssl pkey -in FILE -out FILE` removes it)",
        )
    })?;
    let key = rustls::crypto::ring::sign::any_supported_type(&key).map_err(|error| {
        format!(
            "SWARMWRIGHT_KEY_FILE {} cannot be used: {error}",
            files.key.display()
        )
    })?;
    let certified = CertifiedKey::new(chain, key);
    // Ignore other errors: the broker may accept certificates that `rustls` cannot read, such as X.509 version 1.
    if let Err(rustls::Error::InconsistentKeys(InconsistentKeys::KeyMismatch)) =
        certified.keys_match()
    {
        return Err(format!(
            "SWARMWRIGHT_KEY_FILE {} is not the key of the certificate SWARMWRIGHT_CERTIFICATE_FILE {}",
            files.key.display(),
            files.chain.display()
        ));
    }
    Ok(certified)
}

/// Returns the error if the broker refuses the client certificate or requires one; `None` for other errors.
///
/// In TLS 1.3, a broker reports this only after the client considers the handshake complete.
pub(crate) fn refused(error: &io::Error, settings: &Settings) -> Option<ConnectError> {
    let alert = match error.get_ref()?.downcast_ref::<rustls::Error>()? {
        rustls::Error::AlertReceived(alert) => *alert,
        _ => return None,
    };
    Some(ConnectError::Tls {
        url: settings.url.to_string(),
        reason: describe_alert(alert, settings),
    })
}

/// Explains an alert of the broker, and how to fix the cause.
fn describe_alert(alert: AlertDescription, settings: &Settings) -> String {
    use AlertDescription as A;
    match (alert, &settings.certificate) {
        // This alert is sent if a certificate is missing in TLS 1.2, or if the two sides do not agree on something
        // else.
        (A::HandshakeFailure, certificate) => format!(
            "the broker ends the handshake ({alert:?}): {}, or it shares no version of TLS (this client speaks 1.2 and 1.3) or \
             no cipher with this client; see the broker's log",
            if certificate.is_some() {
                "it refuses the client certificate SWARMWRIGHT_CERTIFICATE_FILE"
            } else {
                "it requires a client certificate (SWARMWRIGHT_CERTIFICATE_FILE and SWARMWRIGHT_KEY_FILE)"
            }
        ),
        (A::CertificateRequired | A::BadCertificate, None) => format!(
            "the broker ends the handshake ({alert:?}): it requires a client certificate; name its file with \
             SWARMWRIGHT_CERTIFICATE_FILE and its private key with SWARMWRIGHT_KEY_FILE (PEM)"
        ),
        (
            A::UnknownCA
            | A::BadCertificate
            | A::UnsupportedCertificate
            | A::CertificateExpired
            | A::CertificateRevoked
            | A::CertificateUnknown
            | A::CertificateRequired
            | A::DecryptError
            | A::AccessDenied,
            Some(files),
        ) => format!(
            "the broker refuses the client certificate SWARMWRIGHT_CERTIFICATE_FILE {} ({alert:?}); it must be signed by an \
             authority that the broker trusts for clients, contain intermediate certificates if there are any, and be valid now",
            files.chain.display()
        ),
        _ => format!("the broker ends the handshake ({alert:?}); see the broker's log"),
    }
}

/// Explains what is wrong with the certificate, and how to fix it.
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
            // A bad signature means that an authority of the same name has another key.
            CertificateError::UnknownIssuer | CertificateError::BadSignature => match &settings.ca_file {
                Some(file) => format!(
                    "the broker's certificate is signed by an authority that is not in {}; name the right file with \
                     SWARMWRIGHT_CA_FILE",
                    file.display()
                ),
                None => "the broker's certificate is signed by an authority that is unknown to this system; name \
                         the authority's certificate with SWARMWRIGHT_CA_FILE"
                    .to_owned(),
            },
            CertificateError::NotValidForNameContext { presented, .. } => format!(
                "the broker's certificate is for {}, not for {host:?}; connect with one of these names or create a certificate \
                 for this one",
                hosts(presented)
            ),
            CertificateError::ExpiredContext { time, not_after } => format!(
                "the broker's certificate has expired, {} ago; renew it, or correct this machine's clock",
                days(*time, *not_after)
            ),
            CertificateError::NotValidYetContext { time, not_before } => format!(
                "the broker's certificate becomes valid only in {}; correct the clock of this machine or of the one where it was \
                 made",
                days(*not_before, *time)
            ),
            CertificateError::Other(OtherError(reason)) if reason.to_string() == "CaUsedAsEndEntity" => {
                "the broker's certificate is that of an authority (CA:TRUE), as `openssl req -x509` makes it; use one that is \
                 signed by an authority: swarmwright broker --init DIR makes both"
                    .to_owned()
            }
            other => format!("the broker's certificate is refused: {other}"),
        },
        rustls::Error::InvalidMessage(_) => {
            "the server does not use TLS; check the port, or use mqtt:// or ws://"
                .to_owned()
        }
        rustls::Error::AlertReceived(alert) => describe_alert(*alert, settings),
        other => other.to_string(),
    }
}

/// Converts `DnsName("localhost")` and `IpAddress(127.0.0.1)` to plain names.
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
