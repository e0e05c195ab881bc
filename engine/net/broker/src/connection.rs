//! A client's socket, its layers and its incomplete packet.

use crate::hub::Hub;
use crate::transport::Layers;
use std::io::{self, ErrorKind, Write};
use std::time::Instant;
use swarmwright_sockets::Socket;

/// Largest number of bytes per read.
pub const CHUNK: usize = 1 << 16;

/// Smallest number of bytes per read.
const LEAST: usize = 512;

/// Largest number of bytes that TLS and WebSocket hold for a client that does not read; half of it is a piece of the
/// outbox.
const UNREAD: usize = 8 * CHUNK;

/// The server's side of a client's connection.
pub struct Connection {
    pub socket: Socket,
    pub layers: Option<Layers>,
    /// Received part of an incomplete packet.
    input: Vec<u8>,
    /// Number of bytes to read next; smaller if packets of this client cause much work.
    portion: usize,
    pub is_ready: bool,
    /// Whether the peer has closed its side and everything was read.
    pub is_ended: bool,
    is_finished: bool,
    pub closing_since: Option<Instant>,
}

impl Connection {
    /// Creates the state of an accepted connection.
    pub fn new(socket: Socket, layers: Option<Layers>) -> Self {
        Self {
            socket,
            layers,
            input: Vec::new(),
            portion: CHUNK,
            is_ready: false,
            is_ended: false,
            is_finished: false,
            closing_since: None,
        }
    }

    /// Returns the number of bytes to read next.
    pub fn portion(&self) -> usize {
        self.portion
    }

    /// Records the work caused by bytes that were read; `share` is the work that they may cause.
    pub fn note_cost(&mut self, bytes: usize, work: usize, share: usize) {
        self.portion = if work > share {
            (bytes * share / work).max(LEAST)
        } else {
            (self.portion * 2).min(CHUNK)
        };
    }

    /// Passes received bytes to the hub and keeps the beginning of an incomplete packet.
    pub fn take(
        &mut self,
        bytes: &[u8],
        hub: &mut Hub,
        id: usize,
        now: Instant,
    ) -> Result<(), String> {
        let mut outcome = Ok(());
        match &mut self.layers {
            None if self.input.is_empty() => {
                let done = hub.receive(id, bytes, now);
                self.input.extend_from_slice(&bytes[done..]);
                return Ok(());
            }
            None => self.input.extend_from_slice(bytes),
            Some(layers) => outcome = layers.received(bytes, &mut self.input),
        }
        let done = hub.receive(id, &self.input, now);
        self.input.drain(..done);
        if self.input.is_empty() {
            self.input.shrink_to(CHUNK);
        }
        // TLS and WebSocket may have answers to send.
        if self
            .layers
            .as_mut()
            .is_some_and(|layers| !layers.outgoing().is_empty())
        {
            self.flush(hub, id, now)
                .map_err(|error| error.to_string())?;
        }
        outcome
    }

    /// Returns the bytes of memory that the connection holds.
    pub fn held(&self) -> usize {
        let layers = self.layers.as_ref().map_or(0, Layers::held);
        self.input.capacity() + layers
    }

    /// Drops the incomplete packet of a connection that is being closed.
    pub fn forget(&mut self) {
        self.input = Vec::new();
    }

    /// Returns whether the client leaves too many answers of the layers (PONG, TLS) unread.
    pub fn is_behind(&self) -> bool {
        let layers = self.layers.as_ref();
        layers.is_some_and(|layers| layers.waiting() > UNREAD)
    }

    /// Shuts down the writing side.
    pub fn finish(&mut self) -> io::Result<()> {
        if !std::mem::replace(&mut self.is_finished, true) {
            self.socket.finish()?;
        }
        Ok(())
    }

    /// Sends as much as the socket accepts; returns whether everything was sent.
    pub fn flush(&mut self, hub: &mut Hub, id: usize, now: Instant) -> io::Result<bool> {
        loop {
            let Some(layers) = &mut self.layers else {
                let outbox = hub.outbox(id);
                if outbox.is_empty() {
                    return Ok(true);
                }
                match self.socket.write(outbox.pending()) {
                    Ok(count) => hub.sent(id, count, now),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => return Err(error),
                }
                continue;
            };
            if layers.outgoing().is_empty() {
                let pending = hub.outbox(id).pending();
                let piece = &pending[..pending.len().min(4 * CHUNK)];
                if piece.is_empty() {
                    return Ok(true);
                }
                layers.send(piece).map_err(io::Error::other)?;
                let count = piece.len();
                hub.sent(id, count, now);
            }
            match self.socket.write(layers.outgoing().pending()) {
                Ok(count) => layers.outgoing().sent(count),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_clients_whose_bytes_cost_much_fewer_are_read_at_a_time() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let socket = std::net::TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let mut connection =
            Connection::new(Socket::Tcp(mio::net::TcpStream::from_std(socket)), None);
        assert_eq!(connection.portion(), CHUNK);
        // Sixteen times the allowed work.
        connection.note_cost(CHUNK, 16_000, 1000);
        assert_eq!(connection.portion(), CHUNK / 16);
        connection.note_cost(CHUNK / 16, 1000, 1000);
        assert_eq!(connection.portion(), CHUNK / 8);
        connection.note_cost(CHUNK / 8, 10_000_000, 1000);
        assert_eq!(connection.portion(), LEAST);
        for _ in 0..20 {
            connection.note_cost(LEAST, 1, 1000);
        }
        assert_eq!(connection.portion(), CHUNK);
    }
}
