//! The embedded MQTT broker: MQTT 5.0, 3.1.1 and 3.1 over TCP, TLS, WebSocket and Unix sockets, in one thread of this process.
//!
//! It stores everything in memory. QoS 0 messages are never dropped for a slow reader: they are kept up to a limit in
//! bytes, publishers are slowed down before it is reached, and a reader that accepts nothing is disconnected with a
//! reason at the limit. Shared subscriptions, topic aliases and enhanced authentication are not supported, which the
//! broker announces to clients. The reasons for a custom broker are in `docs/decisions/001-embedded-broker.md`.
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

/// A running broker. It stops when [`stop`](Self::stop) is called, or when it is dropped.
pub struct Broker {
    address: Option<SocketAddr>,
    websocket: Option<SocketAddr>,
    tls: bool,
    stopper: Stopper,
    /// Configuration, whose files are read again on reload.
    config: Config,
    thread: Mutex<Option<JoinHandle<()>>>,
    #[cfg(unix)]
    file: Mutex<Option<server::SocketFile>>,
}

impl Broker {
    /// Starts to listen; clients can connect once this returns.
    ///
    /// # Errors
    /// Fails if the address or a file of the configuration cannot be used; see [`BrokerError`].
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

    /// Reads the password file, the access file, the certificate with its key, and the authorities of client
    /// certificates again. Connections of accounts that were removed or have another password are closed, and the new
    /// access rules apply to all further messages. All other clients stay connected.
    ///
    /// # Errors
    /// Fails if one of the files cannot be used; nothing changes then.
    pub fn reload(&self) -> Result<(), BrokerError> {
        self.stopper.renew(read_files(&self.config)?);
        Ok(())
    }

    /// Returns the TCP port, also if 0 was configured; 0 without MQTT over TCP.
    pub fn port(&self) -> u16 {
        self.address.map_or(0, |address| address.port())
    }

    /// Returns the addresses of the TCP ports for MQTT and WebSocket.
    pub fn addresses(&self) -> impl Iterator<Item = SocketAddr> {
        [self.address, self.websocket].into_iter().flatten()
    }

    /// Returns the WebSocket port, if configured.
    pub fn websocket_port(&self) -> Option<u16> {
        self.websocket.map(|address| address.port())
    }

    /// Returns the URL for clients on this machine: `mqtt://host:port`, or `mqtts://` with TLS. Without MQTT over TCP,
    /// it is that of the Unix socket or, without one, of the WebSocket.
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

    /// Returns the URL of the Unix socket: `unix:///path`.
    pub fn socket_url(&self) -> Option<String> {
        let path = self.config.socket.as_ref()?;
        Some(format!("unix://{}", path.display()))
    }

    /// Returns the URL for WebSocket clients: `ws://host:port`, or `wss://` with TLS.
    pub fn websocket_url(&self) -> Option<String> {
        self.websocket.map(|address| {
            format!(
                "{}://{}",
                if self.tls { "wss" } else { "ws" },
                reachable(address)
            )
        })
    }

    /// Disconnects all clients, ends the thread, frees the ports and removes the file of the Unix socket. A second call
    /// does nothing.
    pub fn stop(&self) {
        // Remove the file while this broker still listens, so that no other broker takes it for a stale one.
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

/// Returns the absolute path; unchanged if there is no current directory.
fn absolute(path: &Path) -> std::path::PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Replaces an unspecified address, to which clients cannot connect, by loopback.
fn reachable(address: SocketAddr) -> SocketAddr {
    let host = match address.ip() {
        IpAddr::V4(host) if host.is_unspecified() => IpAddr::V4(Ipv4Addr::LOCALHOST),
        IpAddr::V6(host) if host.is_unspecified() => IpAddr::V6(Ipv6Addr::LOCALHOST),
        host => host,
    };
    SocketAddr::new(host, address.port())
}
