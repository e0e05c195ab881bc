//! The embedded MQTT broker: MQTT 5.0, 3.1.1 and 3.1 over TCP, TLS, WebSocket and Unix sockets, in one thread of this process.
//!
//! It keeps everything in memory. Messages of QoS 0 are never dropped for a reader that is behind: they are kept up to a bound
//! in bytes, publishers are slowed down on the way there, and a reader that takes nothing at all is disconnected, with a
//! reason, when the bound is reached. Shared subscriptions, topic aliases and enhanced authentication are not offered, and the
//! broker says so to clients that ask. Reasons for a custom broker: `docs/decisions/001-embedded-broker.md`.
//!
//! ```
//! use swarmwright_broker::{Broker, Config};
//!
//! let broker = Broker::start(&Config::default())?;
//! println!("listening on {}", broker.url());
//! broker.stop();
//! # Ok::<(), swarmwright_broker::BrokerError>(())
//! ```

#[cfg(test)]
#[global_allocator]
static MEMORY: swarmwright_fuzzing::Counting = swarmwright_fuzzing::Counting;

mod access;
mod certificates;
mod config;
mod connection;
mod error;
mod hub;
mod lines;
mod message;
mod outbox;
mod passwords;
mod retained;
mod server;
mod session;
mod subscriptions;
mod transport;

pub use certificates::{Certificates, certify};
pub use config::{Account, Config, Limits};
pub use error::BrokerError;
pub use passwords::{hash_for_mosquitto, hash_password};

use access::Access;
use passwords::{Keys, Passwords, Users};
use server::{Listening, Renewal, Server, Stopper};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::thread::{self, JoinHandle};

/// A running broker. It stops when told to or when dropped.
pub struct Broker {
    address: Option<SocketAddr>,
    websocket: Option<SocketAddr>,
    tls: bool,
    stopper: Stopper,
    /// The configuration at its start, whose files are read again on reload.
    config: Config,
    thread: Mutex<Option<JoinHandle<()>>>,
    #[cfg(unix)]
    file: Mutex<Option<server::SocketFile>>,
}

impl Broker {
    /// Starts to listen; clients can connect when this returns.
    ///
    /// # Errors
    /// The address cannot be listened on, or a file of the configuration cannot be used; see [`BrokerError`].
    pub fn start(config: &Config) -> Result<Self, BrokerError> {
        let Renewal { tls, users, access } = read_files(config)?;
        let origins = transport::Origins::new(&config.origins, tls.is_some())?;
        let listening = Listening::new(config)?;
        let system = |action| move |source| BrokerError::System { action, source };
        let is_tls = tls.is_some();
        let passwords = users
            .map(Passwords::new)
            .transpose()
            .map_err(system("start threads that check passwords"))?;
        let keys = Keys::new(&config.accounts);
        let hub = hub::Hub::new(config.limits.clone(), passwords, keys, access);
        let (server, stopper) = Server::new(listening.listeners, tls, origins, hub)
            .map_err(system("wait for sockets"))?;
        let thread = thread::Builder::new()
            .name("mqtt-broker".into())
            .spawn(move || server.run())
            .map_err(system("start its thread"))?;
        Ok(Self {
            address: listening.address,
            websocket: listening.websocket,
            tls: is_tls,
            stopper,
            config: Config {
                socket: config.socket.as_deref().map(absolute),
                ..config.clone()
            },
            thread: Mutex::new(Some(thread)),
            #[cfg(unix)]
            file: Mutex::new(listening.file),
        })
    }

    /// Reads the password file, the access file, the certificate with its key and the authorities of clients again. Connections that they no longer allow end: those of
    /// removed accounts, or of accounts with another password, are closed, and the new access rules apply to every message from then on. All
    /// other clients stay connected.
    ///
    /// # Errors
    /// One of the files cannot be used; then everything stays as it was.
    pub fn reload(&self) -> Result<(), BrokerError> {
        self.stopper.renew(read_files(&self.config)?);
        Ok(())
    }

    /// The TCP port, the actual one where 0 was asked for; 0 without MQTT over TCP.
    pub fn port(&self) -> u16 {
        self.address.map_or(0, |address| address.port())
    }

    /// The addresses of the TCP ports, of MQTT and of WebSocket.
    pub fn addresses(&self) -> impl Iterator<Item = SocketAddr> {
        [self.address, self.websocket].into_iter().flatten()
    }

    /// The WebSocket port, where one was asked for.
    pub fn websocket_port(&self) -> Option<u16> {
        self.websocket.map(|address| address.port())
    }

    /// Where clients on this machine connect: `mqtt://host:port`, or `mqtts://` with TLS; without MQTT over TCP the Unix socket or,
    /// without one, the WebSocket.
    pub fn url(&self) -> String {
        let tcp = self.address.map(|address| {
            format!(
                "{}://{}",
                if self.tls { "mqtts" } else { "mqtt" },
                reachable(address)
            )
        });
        tcp.or_else(|| self.socket_url())
            .or_else(|| self.websocket_url())
            .unwrap_or_default()
    }

    /// The Unix socket: `unix:///path`.
    pub fn socket_url(&self) -> Option<String> {
        let path = self.config.socket.as_ref()?;
        Some(format!("unix://{}", path.display()))
    }

    /// The same for WebSocket clients: `ws://host:port`, or `wss://` with TLS.
    pub fn websocket_url(&self) -> Option<String> {
        self.websocket.map(|address| {
            format!(
                "{}://{}",
                if self.tls { "wss" } else { "ws" },
                reachable(address)
            )
        })
    }

    /// Tells the clients, closes their connections, ends the thread, frees the ports and removes the file of the Unix socket. A second
    /// call does nothing.
    pub fn stop(&self) {
        // While this broker listens there, no other one takes the file for one that was left behind.
        #[cfg(unix)]
        self.file
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        let thread = self
            .thread
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        if let Some(thread) = thread {
            self.stopper.stop();
            if thread.join().is_err() {
                log::error!("the broker's thread had failed before it was stopped");
            }
        }
    }
}

impl Drop for Broker {
    fn drop(&mut self) {
        self.stop();
    }
}

impl std::fmt::Debug for Broker {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "Broker({})", self.url())
    }
}

/// Reads the files that a configuration names.
fn read_files(config: &Config) -> Result<Renewal, BrokerError> {
    if config.users.is_some() && !config.accounts.is_empty() {
        return Err(BrokerError::TwoKindsOfAccounts);
    }
    let tls = match (&config.certificate, &config.key) {
        (Some(certificate), Some(key)) => {
            let clients = config.client_ca.as_deref();
            Some(transport::server_config(certificate, key, clients)?)
        }
        (None, None) if config.client_ca.is_some() => {
            return Err(BrokerError::ClientsWithoutTls);
        }
        (None, None) => None,
        (None, Some(_)) => {
            return Err(BrokerError::HalfTls {
                missing: "the certificate",
            });
        }
        (Some(_), None) => return Err(BrokerError::HalfTls { missing: "the key" }),
    };
    Ok(Renewal {
        tls,
        users: config.users.as_deref().map(Users::read).transpose()?,
        access: config.access.as_deref().map(Access::read).transpose()?,
    })
}

/// The absolute path; unchanged if the system has no current folder.
fn absolute(path: &Path) -> std::path::PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// "All networks" is not an address to connect to; loopback is one of them.
fn reachable(address: SocketAddr) -> SocketAddr {
    let host = match address.ip() {
        IpAddr::V4(host) if host.is_unspecified() => IpAddr::V4(Ipv4Addr::LOCALHOST),
        IpAddr::V6(host) if host.is_unspecified() => IpAddr::V6(Ipv6Addr::LOCALHOST),
        host => host,
    };
    SocketAddr::new(host, address.port())
}
