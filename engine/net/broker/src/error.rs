//! Errors that prevent the broker from starting, and how to fix them.

use std::io;
use std::path::PathBuf;

/// Why the broker could not start.
#[derive(Debug, thiserror::Error)]
pub enum BrokerError {
    /// Another process listens there.
    #[error(
        "{host}:{port} is in use by another program; choose another port, or 0 for any free one"
    )]
    AddressInUse {
        /// Host asked for.
        host: String,
        /// Port asked for.
        port: u16,
    },
    /// The host is a name or address of another machine, or of none.
    #[error(
        "{host} is not an address of this machine ({source}); use 127.0.0.1 for this machine alone or 0.0.0.0 for all its networks"
    )]
    AddressNotOurs {
        /// Host asked for.
        host: String,
        /// The operating system's answer.
        source: io::Error,
    },
    /// The operating system does not let this user listen there.
    #[error("port {port} needs more rights than this user has; choose a port from 1024 on")]
    PortForbidden {
        /// Port asked for.
        port: u16,
    },
    /// Another process listens on the Unix socket.
    #[error(
        "Unix socket {}: another broker listens there; stop it, or choose another path", path.display()
    )]
    SocketInUse {
        /// Its path.
        path: PathBuf,
    },
    /// The path cannot be that of a Unix socket.
    #[error("Unix socket {}: {wrong}", path.display())]
    SocketPath {
        /// The path asked for.
        path: PathBuf,
        /// What is wrong, and how to fix it.
        wrong: String,
    },
    /// A file that the configuration names cannot be read.
    #[error("{purpose} {}: {source}; check the path and that this user may read it", path.display())]
    Unreadable {
        /// What the file is for.
        purpose: &'static str,
        /// Its path.
        path: PathBuf,
        /// The operating system's answer.
        source: io::Error,
    },
    /// A file can be read but is not what it should be.
    #[error("{purpose} {}{}: {wrong}", path.display(), line.map(|line| format!(", line {line}")).unwrap_or_default())]
    Invalid {
        /// What the file is for.
        purpose: &'static str,
        /// Its path.
        path: PathBuf,
        /// 1-based line, where known.
        line: Option<usize>,
        /// What is wrong and what was expected.
        wrong: String,
    },
    /// Only one of certificate and key was given.
    #[error("TLS needs both a certificate and its key; {missing} is missing")]
    HalfTls {
        /// The one that is missing.
        missing: &'static str,
    },
    /// Client certificates are to be verified, without TLS.
    #[error("client certificates need TLS; the broker's own certificate and its key are missing")]
    ClientsWithoutTls,
    /// A password file and accounts with random passwords.
    #[error("the broker takes either a password file or accounts with random passwords, not both")]
    TwoKindsOfAccounts,
    /// Anything else that the operating system refuses.
    #[error("the broker could not {action}: {source}")]
    System {
        /// What was tried.
        action: &'static str,
        /// The operating system's answer.
        source: io::Error,
    },
}
