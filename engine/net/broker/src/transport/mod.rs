//! The layers between MQTT and the socket: none, TLS, WebSocket, or WebSocket in TLS.

#[cfg(test)]
mod fuzz;
mod origins;
mod tls;
mod websocket;

pub use origins::Origins;
pub use tls::server_config;

use crate::outbox::Outbox;
use rustls::{ServerConfig, ServerConnection};
use std::io::{ErrorKind, Read, Write};
use std::sync::Arc;
use websocket::WebSocket;

/// Approximate memory of TLS per connection in bytes.
const TLS: usize = 32 << 10;

/// Layers of one connection, with the bytes that wait for its socket.
pub struct Layers {
    tls: Option<Box<ServerConnection>>,
    websocket: Option<WebSocket>,
    to_send: Outbox,
}

impl Layers {
    /// Creates the layers of a new connection; `None` if there are none. `websocket`: the web pages that may connect.
    pub fn new(
        tls: Option<&Arc<ServerConfig>>,
        websocket: Option<Arc<Origins>>,
    ) -> Result<Option<Self>, String> {
        if tls.is_none() && websocket.is_none() {
            return Ok(None);
        }
        let tls = match tls {
            Some(config) => {
                let mut connection =
                    ServerConnection::new(Arc::clone(config)).map_err(|error| error.to_string())?;
                // The outbox is bounded, and at most a piece of it is in this buffer.
                connection.set_buffer_limit(None);
                Some(Box::new(connection))
            }
            None => None,
        };
        Ok(Some(Self {
            tls,
            websocket: websocket.map(WebSocket::new),
            to_send: Outbox::default(),
        }))
    }

    /// Returns the bytes for the socket.
    pub fn outgoing(&mut self) -> &mut Outbox {
        &mut self.to_send
    }

    /// Returns the number of bytes that wait for the socket.
    pub fn waiting(&self) -> usize {
        self.to_send.len()
    }

    /// Returns the approximate bytes of memory that the layers hold.
    pub fn held(&self) -> usize {
        let tls = if self.tls.is_some() { TLS } else { 0 };
        self.to_send.capacity() + tls
    }

    /// Processes bytes from the socket; appends MQTT bytes to `mqtt`.
    pub fn received(&mut self, bytes: &[u8], mqtt: &mut Vec<u8>) -> Result<(), String> {
        let Some(tls) = &mut self.tls else {
            return self.unwrapped(bytes, mqtt);
        };
        let mut rest = bytes;
        let mut plain = Vec::new();
        let mut outcome = Ok(());
        while !rest.is_empty() && outcome.is_ok() {
            outcome = tls
                .read_tls(&mut rest)
                .map_err(|error| error.to_string())
                .and_then(|_| {
                    tls.process_new_packets()
                        .map_err(|error| format!("TLS: {error}"))
                })
                .map(drop);
            match tls.reader().read_to_end(&mut plain) {
                Err(error) if error.kind() != ErrorKind::WouldBlock => {
                    return Err(error.to_string());
                }
                _ => {}
            }
        }
        // Send an alert with the reason if the handshake failed.
        self.encrypt()?;
        outcome?;
        self.unwrapped(&plain, mqtt)
    }

    /// Wraps MQTT bytes for the client.
    pub fn send(&mut self, mqtt: &[u8]) -> Result<(), String> {
        match &self.websocket {
            Some(_) => {
                let mut framed = Vec::with_capacity(mqtt.len() + 10);
                websocket::frame(&mut framed, websocket::BINARY, mqtt);
                self.put(&framed)
            }
            None => self.put(mqtt),
        }
    }

    fn unwrapped(&mut self, bytes: &[u8], mqtt: &mut Vec<u8>) -> Result<(), String> {
        let Some(websocket) = &mut self.websocket else {
            mqtt.extend_from_slice(bytes);
            return Ok(());
        };
        let mut replies = Vec::new();
        let outcome = websocket.received(bytes, mqtt, &mut replies);
        self.put(&replies)?;
        outcome
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), String> {
        match &mut self.tls {
            Some(tls) => {
                tls.writer()
                    .write_all(bytes)
                    .map_err(|error| error.to_string())?;
                self.encrypt()
            }
            None => {
                self.to_send.end().extend_from_slice(bytes);
                Ok(())
            }
        }
    }

    fn encrypt(&mut self) -> Result<(), String> {
        if let Some(tls) = &mut self.tls {
            while tls.wants_write() {
                tls.write_tls(self.to_send.end())
                    .map_err(|error| error.to_string())?;
            }
        }
        Ok(())
    }
}
