//! The listening sockets, and what happens to a connection that one of them accepts.

use super::{FIRST, Server};
use crate::BrokerError;
use crate::config::Config;
use crate::connection::Connection;
use crate::transport::Layers;
use mio::net::{TcpListener, TcpStream};
use mio::{Interest, Token};
use std::io::ErrorKind;
use std::sync::Arc;
use std::time::Instant;

pub struct Listener {
    pub socket: TcpListener,
    pub websocket: bool,
}

/// Listening sockets for a configuration, with errors that say how to fix it.
pub fn listen(config: &Config) -> Result<Vec<std::net::TcpListener>, BrokerError> {
    let ports = std::iter::once(config.port).chain(config.websocket_port);
    ports.map(|port| listen_on(&config.host, port)).collect()
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
    pub(super) fn accept(&mut self, place: usize, now: Instant) {
        let Some(listener) = self.listeners.get(place) else {
            return;
        };
        let websocket = listener.websocket;
        loop {
            match self.listeners[place].socket.accept() {
                Ok((socket, peer)) => {
                    let peer = peer.to_string();
                    if let Err(error) = self.welcome(socket, websocket, peer.clone(), now) {
                        self.hub.report_refused(&peer, error, now);
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::Interrupted | ErrorKind::ConnectionAborted
                    ) => {}
                // Most likely no file descriptors are left: an unauthenticated connection is ended. The next tick tries again.
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

    fn welcome(
        &mut self,
        mut socket: TcpStream,
        websocket: bool,
        peer: String,
        now: Instant,
    ) -> Result<(), String> {
        // Several small packets a step must not wait for each other's acknowledgement.
        socket
            .set_nodelay(true)
            .map_err(|error| error.to_string())?;
        let origins = websocket.then(|| Arc::clone(&self.origins));
        let layers = Layers::new(self.tls.as_ref(), origins)?;
        self.hub.make_room();
        self.close_dropped(now);
        let Some(id) = self.hub.open(peer, now) else {
            return Ok(());
        };
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
