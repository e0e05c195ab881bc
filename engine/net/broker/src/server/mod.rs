//! Event loop: all sockets in one thread.
//!
//! Everything that has arrived since the last turn is routed first; then each connection's bytes are sent with one
//! system call.

mod control;
mod listening;
#[cfg(unix)]
mod unix;

pub use control::{Renewal, Stopper};
pub use listening::Listening;
#[cfg(unix)]
pub use unix::SocketFile;

use crate::connection::{CHUNK, Connection};
use crate::hub::Hub;
use crate::transport::Origins;
use listening::Listener;
use mio::event::Event;
use mio::{Events, Interest, Poll, Token, Waker};
use rustls::ServerConfig;
use std::io::{self, ErrorKind, Read};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

const TICK: Duration = Duration::from_secs(1);
/// Interval between checks whether publishers that are held back can be read.
const HELD: Duration = Duration::from_millis(2);
/// How long a closing connection has to send its last packets.
const LINGER: Duration = Duration::from_secs(2);
/// Largest number of reads of one connection before the others get their turn.
const CHUNKS: usize = 4;
/// Work of all reads of one turn together, in units of `Hub::work`: half a millisecond.
const TURN: usize = 1 << 14;
/// Smallest share of that work for one connection.
const LEAST_SHARE: usize = 256;
const WAKE: Token = Token(usize::MAX);
/// Number of the first token of connections, after those of the listeners.
const FIRST: usize = 3;

/// The server, before it runs.
pub struct Server {
    poll: Poll,
    listeners: Vec<Listener>,
    tls: Option<Arc<ServerConfig>>,
    origins: Arc<Origins>,
    hub: Hub,
    connections: Vec<Option<Connection>>,
    /// Connections that may have unread bytes.
    ready: Vec<usize>,
    /// Whether all clients that wait for retained messages have to read first.
    stuck: bool,
    chunk: Box<[u8]>,
    stop: Arc<AtomicBool>,
    renewal: Arc<Mutex<Option<Renewal>>>,
}

impl Server {
    /// Creates a server on sockets that already listen.
    pub fn new(
        mut listeners: Vec<Listener>,
        tls: Option<Arc<ServerConfig>>,
        origins: Origins,
        mut hub: Hub,
    ) -> io::Result<(Self, Stopper)> {
        let poll = Poll::new()?;
        for (index, listener) in listeners.iter_mut().enumerate() {
            poll.registry()
                .register(listener.source(), Token(index), Interest::READABLE)?;
        }
        let stop = Arc::new(AtomicBool::new(false));
        let renewal = Arc::new(Mutex::new(None));
        let waker = Arc::new(Waker::new(poll.registry(), WAKE)?);
        let stopper = Stopper {
            stop: Arc::clone(&stop),
            renewal: Arc::clone(&renewal),
            waker: Arc::clone(&waker),
        };
        hub.wake_with(Box::new(move || {
            if let Err(error) = waker.wake() {
                log::error!("the broker could not be woken: {error}");
            }
        }));
        let server = Self {
            poll,
            listeners,
            tls,
            origins: Arc::new(origins),
            hub,
            connections: Vec::new(),
            ready: Vec::new(),
            stuck: false,
            chunk: vec![0; CHUNK].into(),
            stop,
            renewal,
        };
        Ok((server, stopper))
    }

    /// Serves until stopped.
    pub fn run(mut self) {
        let mut events = Events::with_capacity(256);
        let mut last_tick = Instant::now();
        let mut now = last_tick;
        while !self.stop.load(Ordering::Acquire) {
            let wait = self.poll_timeout(last_tick, now);
            match self.poll.poll(&mut events, wait) {
                Err(error) if error.kind() != ErrorKind::Interrupted => {
                    log::error!("the broker stops, since waiting for its sockets failed: {error}");
                    break;
                }
                _ => {}
            }
            now = Instant::now();
            // Tick first: there are no ticks while no client is connected, and the next client must not find an expired
            // session.
            if now - last_tick >= TICK {
                last_tick = now;
                self.tick(now);
            }
            for event in &events {
                self.note(event, now);
            }
            self.renew(now);
            let ready = std::mem::take(&mut self.ready);
            let share = (TURN / ready.len().max(1)).max(LEAST_SHARE);
            for id in ready {
                self.read(id, share, now);
            }
            self.admit(now);
            self.stuck = self.hub.is_searching() && !self.hub.search(now);
            self.flush_all(now);
        }
        self.hub.stop();
        self.flush_all(now);
    }

    /// Returns how long to wait for sockets.
    fn poll_timeout(&mut self, last_tick: Instant, now: Instant) -> Option<Duration> {
        let checks = self.hub.checks_due(now);
        let checks = checks.map(|due| due.saturating_duration_since(now));
        let others = self.timeout_of_connections(last_tick, now);
        checks.into_iter().chain(others).min()
    }

    fn timeout_of_connections(&mut self, last_tick: Instant, now: Instant) -> Option<Duration> {
        if self.hub.is_searching() {
            return Some(if self.stuck { HELD } else { Duration::ZERO });
        }
        if self.ready.is_empty() {
            let any = self.connections.iter().any(Option::is_some);
            return any.then(|| (last_tick + TICK).saturating_duration_since(now));
        }
        let (hub, connections) = (&mut self.hub, &self.connections);
        let all_held = self
            .ready
            .iter()
            .all(|&id| hub.is_held(id, now) || is_behind(connections, id));
        Some(if all_held { HELD } else { Duration::ZERO })
    }

    fn note(&mut self, event: &Event, now: Instant) {
        match event.token() {
            WAKE => {}
            Token(index) if index < FIRST => self.accept(index, now),
            Token(token) => {
                let id = token - FIRST;
                // The connection may have ended since the event.
                let Some(Some(connection)) = self.connections.get_mut(id) else {
                    return;
                };
                connection.is_ended |= event.is_read_closed() || event.is_error();
                if (event.is_readable() || connection.is_ended) && !connection.is_ready {
                    connection.is_ready = true;
                    self.ready.push(id);
                }
                if event.is_writable() {
                    self.flush(id, now);
                }
            }
        }
    }

    /// Applies reloaded files.
    fn renew(&mut self, now: Instant) {
        let renewal = self
            .renewal
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        if let Some(renewal) = renewal {
            // Existing connections keep their negotiated parameters.
            self.tls = renewal.tls;
            self.hub.replace(renewal.users, renewal.access, now);
        }
    }

    /// Answers clients whose passwords have been checked, and continues to read from them.
    fn admit(&mut self, now: Instant) {
        for id in self.hub.answer_checked(now) {
            if let Some(Some(connection)) = self.connections.get_mut(id)
                && let Err(why) = connection.take(&[], &mut self.hub, id, now)
            {
                log::debug!("connection {id}: {why}");
                self.close(id, now);
            }
        }
    }

    /// Reads from a connection and handles its packets, until they have used up their share of work.
    fn read(&mut self, id: usize, share: usize, now: Instant) {
        let before = self.hub.work();
        for _ in 0..CHUNKS {
            let spent = self.hub.work() - before;
            if spent >= share {
                break;
            }
            let Some(Some(connection)) = self.connections.get_mut(id) else {
                return;
            };
            // A client that leaves while its password is being checked needs no answer.
            if connection.is_ended && self.hub.is_asking(id) {
                return self.close(id, now);
            }
            if connection.is_behind() || self.hub.is_held(id, now) {
                break;
            }
            let portion = connection.portion();
            match connection.socket.read(&mut self.chunk[..portion]) {
                Ok(0) => return self.close(id, now),
                Ok(count) => {
                    self.hub.note_bytes(count);
                    let outcome = connection.take(&self.chunk[..count], &mut self.hub, id, now);
                    connection.note_cost(count, self.hub.work() - before - spent, share);
                    self.hub.note_buffers(id, connection.held(), now);
                    if let Err(why) = outcome {
                        log::debug!("connection {id}: {why}");
                        connection.is_ended = true;
                        self.flush(id, now);
                        return self.close(id, now);
                    }
                    // A short read has emptied the socket; further bytes cause a new event.
                    if count < portion && !connection.is_ended {
                        connection.is_ready = false;
                        return;
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    connection.is_ready = false;
                    return;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return self.close(id, now),
            }
        }
        self.ready.push(id);
    }

    fn tick(&mut self, now: Instant) {
        self.hub.tick(now);
        for index in 0..self.listeners.len() {
            self.accept(index, now);
        }
        for id in 0..self.connections.len() {
            let since = self.connections[id]
                .as_ref()
                .and_then(|connection| connection.closing_since);
            if since.is_some_and(|since| now - since > LINGER) {
                self.close(id, now);
            }
        }
    }

    fn flush_all(&mut self, now: Instant) {
        // Closing a connection may publish its will, which makes other connections dirty.
        loop {
            let dirty = self.hub.take_dirty();
            if dirty.is_empty() {
                return;
            }
            for id in dirty {
                self.flush(id, now);
            }
        }
    }

    fn flush(&mut self, id: usize, now: Instant) {
        let Some(Some(connection)) = self.connections.get_mut(id) else {
            return;
        };
        if self.hub.is_closing(id) {
            connection.forget();
        }
        let outcome = connection.flush(&mut self.hub, id, now);
        self.hub.note_buffers(id, connection.held(), now);
        if outcome.is_ok() && !self.hub.is_closing(id) {
            return;
        }
        // The client reads the last packets and then the end. Wait for the client to close, since a reset would discard
        // them.
        let is_over = match outcome {
            Ok(true) => connection.finish().is_err(),
            Ok(false) => false,
            Err(_) => true,
        };
        connection.closing_since.get_or_insert(now);
        if is_over {
            self.close(id, now);
        }
    }

    fn close_dropped(&mut self, now: Instant) {
        for id in self.hub.take_dropped() {
            self.close(id, now);
        }
    }

    fn close(&mut self, id: usize, now: Instant) {
        if let Some(mut connection) = self.connections.get_mut(id).and_then(Option::take) {
            if let Err(error) = self.poll.registry().deregister(&mut connection.socket) {
                log::debug!("connection {id}: {error}");
            }
            self.hub.closed(id, now);
        }
    }
}

fn is_behind(connections: &[Option<Connection>], id: usize) -> bool {
    let connection = connections.get(id).and_then(Option::as_ref);
    connection.is_some_and(Connection::is_behind)
}
