//! Web pages that may connect: any page that a user of this machine opens can make the browser open a WebSocket to it.

use crate::BrokerError;
use std::io;
use std::net::IpAddr;

/// Pages that may connect, by origin (RFC 6454).
#[derive(Debug, Default)]
pub struct Origins {
    allowed: Vec<String>,
    any: bool,
    /// Whether TLS is used, so that browsers have verified the host of the request.
    tls: bool,
}

impl Origins {
    /// Creates the rules. `allowed`: origins such as `https://dashboard.example.org` or `http://localhost:8000`, `*`
    /// for all, `null` for files.
    pub fn new(allowed: &[String], tls: bool) -> Result<Self, BrokerError> {
        for origin in allowed {
            let host = origin.split_once("://").map(|(_, host)| host);
            let is_origin = host.is_some_and(|host| !host.is_empty() && !host.contains('/'));
            if !is_origin && origin != "*" && origin != "null" {
                return Err(BrokerError::System {
                    action: "use an origin",
                    source: io::Error::other(format!(
                        "{origin:?} is not an origin; write it like https://dashboard.example.org, without a path, or * for all"
                    )),
                });
            }
        }
        Ok(Self {
            allowed: allowed
                .iter()
                .map(|origin| origin.to_ascii_lowercase())
                .collect(),
            any: allowed.iter().any(|origin| origin == "*"),
            tls,
        })
    }

    /// Returns whether a page of this origin may connect to the requested host. Clients other than browsers send no
    /// origin.
    pub fn allow(&self, origin: Option<&str>, host: Option<&str>) -> bool {
        let Some(origin) = origin else {
            return true;
        };
        let origin = origin.to_ascii_lowercase();
        if self.any || self.allowed.contains(&origin) {
            return true;
        }
        let (Some((_, page)), Some(host)) = (origin.split_once("://"), host) else {
            return false;
        };
        let host = host.to_ascii_lowercase();
        let (page, host) = (name(page), name(&host));
        // Without a certificate, an attacker can point a domain name at this machine and serve a page under it.
        page == host && (self.tls || is_literal(host))
    }
}

/// Returns the host of `host:port`.
fn name(authority: &str) -> &str {
    match authority.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => authority.split(':').next().unwrap_or_default(),
    }
}

/// Returns whether others cannot change the address of this host.
fn is_literal(host: &str) -> bool {
    host == "localhost" || host.parse::<IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origins(allowed: &[&str], tls: bool) -> Origins {
        let allowed: Vec<String> = allowed.iter().map(|&one| one.to_owned()).collect();
        Origins::new(&allowed, tls).unwrap()
    }

    #[test]
    fn pages_of_the_same_host_may_and_others_may_not() {
        let plain = origins(&[], false);
        for (origin, host, may) in [
            (None, Some("localhost:9001"), true),
            (None, None, true),
            (Some("http://localhost:8000"), Some("localhost:9001"), true),
            (Some("http://127.0.0.1"), Some("127.0.0.1:9001"), true),
            (Some("http://[::1]:8000"), Some("[::1]:9001"), true),
            (Some("http://Localhost"), Some("LOCALHOST:9001"), true),
            (Some("http://evil.example"), Some("localhost:9001"), false),
            (
                Some("http://localhost.evil.example"),
                Some("localhost:9001"),
                false,
            ),
            // A domain of the attacker's page that resolves to this machine.
            (
                Some("http://evil.example"),
                Some("evil.example:9001"),
                false,
            ),
            (Some("null"), Some("localhost:9001"), false),
            (Some(""), Some(""), false),
            (Some("http://localhost:8000"), None, false),
        ] {
            assert_eq!(plain.allow(origin, host), may, "{origin:?} at {host:?}");
        }
        let secure = origins(&[], true);
        assert!(secure.allow(Some("https://lab.example"), Some("lab.example:8884")));
        assert!(!secure.allow(Some("https://evil.example"), Some("lab.example:8884")));
    }

    #[test]
    fn origins_that_are_named_may() {
        let named = origins(&["https://Dash.example", "null"], false);
        for (origin, may) in [
            ("https://dash.example", true),
            ("null", true),
            ("http://dash.example", false),
            ("https://dash.example:444", false),
        ] {
            assert_eq!(
                named.allow(Some(origin), Some("localhost:9001")),
                may,
                "{origin}"
            );
        }
        assert!(origins(&["*"], false).allow(Some("http://evil.example"), None));
        for wrong in ["dash.example", "https://", "https://dash.example/", ""] {
            let error = Origins::new(&[wrong.to_owned()], false).unwrap_err();
            assert!(error.to_string().contains("https://dashboard.example.org"));
        }
    }
}
