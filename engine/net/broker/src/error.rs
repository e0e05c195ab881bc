//! Errors that prevent the broker from starting, and how to fix them.

use std::io;
use std::path::PathBuf;

/// The error type of the start of a broker.
#[derive(Debug, thiserror::Error)]
pub enum BrokerError {
    /// Another process listens at the address.
    #[error(
        "{host}:{port} is in use by another program; choose another port, or 0 for any free one"
    )]
    AddressInUse {
        /// Requested host.
        host: String,
        /// Requested port.
        port: u16,
    },
    /// The host is not an address of this machine.
    #[error(
        "{host} is not an address of this machine ({source}); use 127.0.0.1 for this machine alone or 0.0.0.0 for all its networks"
    )]
    AddressNotOurs {
        /// Requested host.
        host: String,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The operating system does not let this user listen on the port.
    #[error("port {port} needs more rights than this user has; choose a port from 1024 on")]
    PortForbidden {
        /// Requested port.
        port: u16,
    },
    /// Another process listens on the Unix socket.
    #[error(
        "Unix socket {}: another broker listens there; stop it, or choose another path", path.display()
    )]
    SocketInUse {
        /// Path of the socket.
        path: PathBuf,
    },
    /// The path is not valid for a Unix socket.
    #[error("Unix socket {}: {wrong}", path.display())]
    SocketPath {
        /// Requested path.
        path: PathBuf,
        /// Problem, and how to fix it.
        wrong: String,
    },
    /// A file that the configuration names cannot be read.
    #[error("{purpose} {}: {source}; check the path and that this user may read it", path.display())]
    Unreadable {
        /// Purpose of the file.
        purpose: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The content of a file is invalid.
    #[error("{purpose} {}{}: {wrong}", path.display(), line.map(|line| format!(", line {line}")).unwrap_or_default())]
    Invalid {
        /// Purpose of the file.
        purpose: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Line number from 1, if known.
        line: Option<usize>,
        /// Problem, and what was expected.
        wrong: String,
    },
    /// Only one of certificate and key was given.
    #[error("TLS needs both a certificate and its key; {missing} is missing")]
    HalfTls {
        /// Name of the missing part.
        missing: &'static str,
    },
    /// Client certificates are required, but TLS is not configured.
    #[error("client certificates need TLS; the broker's own certificate and its key are missing")]
    ClientsWithoutTls,
    /// Both a password file and accounts with random passwords are configured.
    #[error("the broker takes either a password file or accounts with random passwords, not both")]
    TwoKindsOfAccounts,
    /// Any other error of the operating system.
    #[error("the broker could not {action}: {source}")]
    System {
        /// The action that failed.
        action: &'static str,
        /// Error of the operating system.
        source: io::Error,
    },
}
