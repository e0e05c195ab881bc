//! Creation of a certificate authority and a broker's certificate signed by it.

use crate::BrokerError;
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};
use std::io;
use time::{Duration, OffsetDateTime};

/// Smallest number of days for which the authority is valid; the broker's certificate has its own term.
const AUTHORITY_DAYS: i64 = 3650;

/// An authority and the certificate that it signed, in PEM format; keys are ECDSA P-256, PKCS #8.
pub struct Certificates {
    /// Certificate of the authority, which clients trust.
    pub authority: String,
    /// Private key of the authority. It must be kept secret, since it signs certificates that these clients trust.
    pub authority_key: String,
    /// Certificate of the broker.
    pub certificate: String,
    /// Private key of the broker.
    pub key: String,
}

/// Creates an authority valid for at least ten years, and a certificate for `hosts` (at least one name or IP address)
/// valid for `days` days.
///
/// Both are valid from an hour ago, since clocks differ.
///
/// # Errors
/// Fails if a host is not valid in a certificate, or if the operating system provides no random numbers.
pub fn certify(hosts: &[String], days: i64) -> Result<Certificates, BrokerError> {
    make(hosts, days).map_err(|error| BrokerError::System {
        action: "make certificates",
        source: io::Error::other(error.to_string()),
    })
}

fn make(hosts: &[String], days: i64) -> Result<Certificates, rcgen::Error> {
    let now = OffsetDateTime::now_utc();
    let mut authority = CertificateParams::default();
    authority.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    authority.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let host = hosts.first().map_or("broker", String::as_str);
    authority.distinguished_name = named(&format!("authority of {host}"));
    authority.not_before = now - Duration::hours(1);
    authority.not_after = now + Duration::days(AUTHORITY_DAYS.max(days));
    let authority_key = KeyPair::generate()?;
    let root = authority.self_signed(&authority_key)?;
    let issuer = Issuer::new(authority, &authority_key);

    let mut broker = CertificateParams::new(hosts)?;
    broker.distinguished_name = named(host);
    broker.use_authority_key_identifier_extension = true;
    broker.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    broker.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
    broker.not_before = now - Duration::hours(1);
    broker.not_after = now + Duration::days(days);
    let key = KeyPair::generate()?;
    let certificate = broker.signed_by(&key, &issuer)?;
    Ok(Certificates {
        authority: root.pem(),
        authority_key: authority_key.serialize_pem(),
        certificate: certificate.pem(),
        key: key.serialize_pem(),
    })
}

fn named(name: &str) -> rcgen::DistinguishedName {
    let mut names = rcgen::DistinguishedName::new();
    names.push(DnType::CommonName, name);
    names
}
