//! TLS: the certificate and its key, and the authorities that sign certificates of clients.

use crate::BrokerError;
use rustls::crypto::ring::default_provider;
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::WebPkiClientVerifier;
use rustls::server::danger::ClientCertVerifier;
use rustls::{RootCertStore, ServerConfig};
use std::io;
use std::path::Path;
use std::sync::Arc;

/// Reads a certificate chain and its private key, both PEM. With `client_ca`, every client needs a certificate signed
/// by an authority in that file.
pub fn server_config(
    certificate: &Path,
    key: &Path,
    client_ca: Option<&Path>,
) -> Result<Arc<ServerConfig>, BrokerError> {
    let chain = certificates("certificate", certificate)?;
    let verifier = client_ca.map(verifier).transpose()?;
    let secret =
        PrivateKeyDer::from_pem_file(key).map_err(|error| explain("private key", key, error))?;
    let config = ServerConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .map(|builder| match verifier {
            Some(verifier) => builder.with_client_cert_verifier(verifier),
            None => builder.with_no_client_auth(),
        })
        .and_then(|builder| builder.with_single_cert(chain, secret))
        .map_err(|error| BrokerError::Invalid {
            purpose: "private key",
            path: key.into(),
            line: None,
            wrong: format!(
                "does not match the certificate {}: {error}",
                certificate.display()
            ),
        })?;
    Ok(Arc::new(config))
}

/// Reads the certificates in a file, which must contain at least one.
fn certificates(
    purpose: &'static str,
    path: &Path,
) -> Result<Vec<CertificateDer<'static>>, BrokerError> {
    let certificates: Vec<_> = CertificateDer::pem_file_iter(path)
        .and_then(Iterator::collect)
        .map_err(|error| explain(purpose, path, error))?;
    if certificates.is_empty() {
        return Err(explain(purpose, path, pem::Error::NoItemsFound));
    }
    Ok(certificates)
}

/// Creates a verifier of client certificates, which must be signed by an authority in the file.
fn verifier(authorities: &Path) -> Result<Arc<dyn ClientCertVerifier>, BrokerError> {
    let purpose = "certificate authority of clients";
    let invalid = |wrong: String| BrokerError::Invalid {
        purpose,
        path: authorities.into(),
        line: None,
        wrong,
    };
    let mut roots = RootCertStore::empty();
    for authority in certificates(purpose, authorities)? {
        roots
            .add(authority)
            .map_err(|error| invalid(error.to_string()))?;
    }
    let provider = Arc::new(default_provider());
    WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider)
        .build()
        .map(|built| built as Arc<dyn ClientCertVerifier>)
        .map_err(|error| invalid(error.to_string()))
}

fn explain(purpose: &'static str, path: &Path, error: pem::Error) -> BrokerError {
    let path = path.into();
    match error {
        pem::Error::Io(source) => BrokerError::Unreadable {
            purpose,
            path,
            source,
        },
        pem::Error::NoItemsFound => {
            let wrong = format!(
                "contains no {purpose}; expected a PEM file with a block `-----BEGIN ...-----`"
            );
            BrokerError::Invalid {
                purpose,
                path,
                line: None,
                wrong,
            }
        }
        other => {
            let source = io::Error::new(io::ErrorKind::InvalidData, format!("{other:?}"));
            BrokerError::Unreadable {
                purpose,
                path,
                source,
            }
        }
    }
}
