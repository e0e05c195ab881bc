//! TLS: the certificate and its key.

use crate::BrokerError;
use rustls::ServerConfig;
use rustls::crypto::ring::default_provider;
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use std::io;
use std::path::Path;
use std::sync::Arc;

/// Reads a certificate chain and its private key, both PEM.
pub fn server_config(certificate: &Path, key: &Path) -> Result<Arc<ServerConfig>, BrokerError> {
    let chain: Vec<CertificateDer<'static>> = CertificateDer::pem_file_iter(certificate)
        .and_then(Iterator::collect)
        .map_err(|error| explain("certificate", certificate, error))?;
    if chain.is_empty() {
        return Err(explain(
            "certificate",
            certificate,
            pem::Error::NoItemsFound,
        ));
    }
    let secret =
        PrivateKeyDer::from_pem_file(key).map_err(|error| explain("private key", key, error))?;
    let config = ServerConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .map(|builder| builder.with_no_client_auth())
        .and_then(|builder| builder.with_single_cert(chain, secret))
        .map_err(|error| BrokerError::Invalid {
            what: "private key",
            path: key.into(),
            line: None,
            wrong: format!(
                "does not go with the certificate {}: {error}",
                certificate.display()
            ),
        })?;
    Ok(Arc::new(config))
}

fn explain(what: &'static str, path: &Path, error: pem::Error) -> BrokerError {
    let path = path.into();
    match error {
        pem::Error::Io(source) => BrokerError::Unreadable { what, path, source },
        pem::Error::NoItemsFound => {
            let wrong = format!(
                "no {what} in it; a PEM file with a block `-----BEGIN ...-----` is expected"
            );
            BrokerError::Invalid {
                what,
                path,
                line: None,
                wrong,
            }
        }
        other => {
            let source = io::Error::new(io::ErrorKind::InvalidData, format!("{other:?}"));
            BrokerError::Unreadable { what, path, source }
        }
    }
}
