//! Listening sockets, and the setup of accepted connections.

use super::{FIRST, Server};
use crate::BrokerError;
use crate::config::Config;
use crate::connection::Connection;
use crate::transport::Layers;
use mio::event::Source;
use mio::net::TcpListener;
#[cfg(unix)]
use mio::net::UnixListener;
use mio::{Interest, Token};
use std::io::{self, ErrorKind};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use swarmwright_sockets::Socket;

/// A listening socket.
pub enum Listener {
    Tcp {
        socket: TcpListener,
        websocket: bool,
    },
    #[cfg(unix)]
    Unix {
        socket: UnixListener,
        /// Name of its clients, which have no addresses.
        peer: String,
    },
}

impl Listener {
    pub fn source(&mut self) -> &mut dyn Source {
        match self {
            Self::Tcp { socket, .. } => socket,
            #[cfg(unix)]
            Self::Unix { socket, .. } => socket,
        }
    }

    /// Accepts a waiting client, and returns its name for messages.
    fn accept(&self) -> io::Result<(Socket, String)> {
        match self {
            Self::Tcp { socket, .. } => {
                let (stream, peer) = socket.accept()?;
                Ok((Socket::Tcp(stream), peer.to_string()))
            }
            #[cfg(unix)]
            Self::Unix { socket, peer } => {
                let (stream, _) = socket.accept()?;
                Ok((Socket::Unix(stream), peer.clone()))
            }
        }
    }
}

/// The sockets on which a broker listens, and their addresses.
pub struct Listening {
    pub listeners: Vec<Listener>,
    pub address: Option<SocketAddr>,
    pub websocket: Option<SocketAddr>,
    #[cfg(unix)]
    pub file: Option<super::unix::SocketFile>,
}

impl Listening {
    /// Listens on all addresses of a configuration.
    pub fn new(config: &Config) -> Result<Self, BrokerError> {
        let mut listening = Self {
            listeners: Vec::new(),
            address: None,
            websocket: None,
            #[cfg(unix)]
            file: None,
        };
        listening.address = listening.listen_on(&config.host, config.port, false)?;
        listening.websocket = listening.listen_on(&config.host, config.websocket_port, true)?;
        if let Some(path) = &config.socket {
            listening.listen_at(path, config.socket_mode)?;
        }
        if listening.listeners.is_empty() {
            return Err(BrokerError::System {
                action: "listen",
                source: io::Error::other("neither a port nor a Unix socket is set"),
            });
        }
        Ok(listening)
    }

    fn listen_on(
        &mut self,
        host: &str,
        port: Option<u16>,
        websocket: bool,
    ) -> Result<Option<SocketAddr>, BrokerError> {
        let Some(port) = port else { return Ok(None) };
        let system = |action| move |source| BrokerError::System { action, source };
        let socket = listen_on(host, port)?;
        let address = socket
            .local_addr()
            .map_err(system("read its own address"))?;
        socket
            .set_nonblocking(true)
            .map_err(system("wait for sockets"))?;
        let socket = TcpListener::from_std(socket);
        self.listeners.push(Listener::Tcp { socket, websocket });
        Ok(Some(address))
    }

    #[cfg(unix)]
    fn listen_at(&mut self, path: &Path, mode: u32) -> Result<(), BrokerError> {
        let (socket, file) = super::unix::listen(path, mode)?;
        socket
            .set_nonblocking(true)
            .map_err(|source| BrokerError::System {
                action: "wait for sockets",
                source,
            })?;
        self.listeners.push(Listener::Unix {
            socket: UnixListener::from_std(socket),
            peer: format!("a client at {}", file.path().display()),
        });
        self.file = Some(file);
        Ok(())
    }

    #[cfg(not(unix))]
    #[expect(clippy::unused_self, reason = "as on Unix")]
    fn listen_at(&mut self, path: &Path, _mode: u32) -> Result<(), BrokerError> {
        Err(BrokerError::SocketPath {
            path: path.into(),
            wrong: "this system has no Unix sockets for brokers; use a port".to_owned(),
        })
    }
}

fn listen_on(host: &str, port: u16) -> Result<std::net::TcpListener, BrokerError> {
    use BrokerError as E;
    std::net::TcpListener::bind((host, port)).map_err(|source| match source.kind() {
        ErrorKind::AddrInUse => E::AddressInUse {
            host: host.into(),
            port,
        },
        ErrorKind::PermissionDenied => E::PortForbidden { port },
        _ => E::AddressNotOurs {
            host: host.into(),
            source,
        },
    })
}

impl Server {
    pub(super) fn accept(&mut self, index: usize, now: Instant) {
        loop {
            let Some(listener) = self.listeners.get(index) else {
                return;
            };
            match listener.accept() {
                Ok((socket, peer)) => {
                    let layers = self.layers(listener);
                    if let Err(error) = self.welcome(socket, layers, peer.clone(), now) {
                        self.hub.report_refused(&peer, error, now);
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::Interrupted | ErrorKind::ConnectionAborted
                    ) => {}
                // Most likely there are no file descriptors left, so end an unauthenticated connection. The next tick
                // tries again.
                Err(error) => {
                    self.hub.report_refused("a client", error, now);
                    if !self.hub.end_unauthenticated() {
                        return;
                    }
                    self.close_dropped(now);
                }
            }
        }
    }

    /// Creates the layers between MQTT and the socket of a listener's client.
    fn layers(&self, listener: &Listener) -> Result<Option<Layers>, String> {
        match listener {
            Listener::Tcp { websocket, .. } => {
                let origins = websocket.then(|| Arc::clone(&self.origins));
                Layers::new(self.tls.as_ref(), origins)
            }
            // The bytes do not leave this machine.
            #[cfg(unix)]
            Listener::Unix { .. } => Ok(None),
        }
    }

    fn welcome(
        &mut self,
        mut socket: Socket,
        layers: Result<Option<Layers>, String>,
        peer: String,
        now: Instant,
    ) -> Result<(), String> {
        // The small packets of a step must not wait for each other's acknowledgement.
        socket.send_at_once().map_err(|error| error.to_string())?;
        let layers = layers?;
        self.hub.make_room();
        self.close_dropped(now);
        #[cfg(unix)]
        let is_private = matches!(socket, Socket::Unix(_));
        let Some(id) = self.hub.open(peer, now) else {
            return Ok(());
        };
        #[cfg(unix)]
        if is_private {
            self.hub.note_private(id);
        }
        let interest = Interest::READABLE | Interest::WRITABLE;
        if let Err(error) = self
            .poll
            .registry()
            .register(&mut socket, Token(id + FIRST), interest)
        {
            self.hub.closed(id, now);
            return Err(error.to_string());
        }
        if self.connections.len() <= id {
            self.connections.resize_with(id + 1, || None);
        }
        self.connections[id] = Some(Connection::new(socket, layers));
        Ok(())
    }
}
