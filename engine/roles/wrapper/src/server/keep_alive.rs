//! Keeps a server connected while its simulations compute.

use std::ops::{Deref, DerefMut};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use swarmwright_mqtt::{Connection, Event};

/// Number of polls per keep-alive interval. The session pings after half of the interval at the latest, and expects the
/// answer within the other half.
const POLLS: u32 = 8;
/// Largest number of buffered events; further messages stay in the socket's buffers.
const MOST_BUFFERED: usize = 10_000;
const STACK: usize = 512 * 1024;

/// A connection, and the events that arrived while the server did not poll it.
pub(super) struct BufferedConnection {
    connection: Connection,
    buffer: Vec<Event>,
    /// Whether the thread has polled since the server did, and may have consumed a wake-up.
    polled: bool,
}

impl BufferedConnection {
    /// Like the connection's `poll`; buffered events come first.
    pub(super) fn poll(&mut self, until: Instant, events: &mut Vec<Event>) {
        events.append(&mut self.buffer);
        let until = if std::mem::take(&mut self.polled) {
            Instant::now()
        } else {
            until
        };
        self.connection.poll(until, events);
    }

    /// Exchanges pings with the broker, and buffers incoming events. Does not restore a broken connection, since the
    /// current computation is lost with it.
    fn keep(&mut self) {
        let broke = |event: &Event| matches!(event, Event::Disconnected { .. });
        if self.buffer.len() < MOST_BUFFERED && !self.buffer.iter().any(broke) {
            self.polled = true;
            // `poll` only waits if `events` is not empty.
            let mut events = Vec::new();
            self.connection.poll(Instant::now(), &mut events);
            self.buffer.append(&mut events);
        }
    }
}

impl Deref for BufferedConnection {
    type Target = Connection;

    fn deref(&self) -> &Connection {
        &self.connection
    }
}

impl DerefMut for BufferedConnection {
    fn deref_mut(&mut self) -> &mut Connection {
        &mut self.connection
    }
}

/// A connection that a thread polls while its owner has not locked it, because a step of a simulation may take longer
/// than the keep-alive interval.
pub(super) struct KeepAlive {
    connection: Arc<Mutex<BufferedConnection>>,
    /// Ends the thread when dropped.
    stop: Sender<()>,
    thread: Option<JoinHandle<()>>,
}

impl KeepAlive {
    /// Creates the thread; `interval` is the keep-alive interval in seconds, as in the settings.
    pub(super) fn new(connection: Connection, interval: u16) -> Self {
        let connection = Arc::new(Mutex::new(BufferedConnection {
            connection,
            buffer: Vec::new(),
            polled: false,
        }));
        let (stop, stopped) = mpsc::channel();
        let shared = Arc::clone(&connection);
        let pause = Duration::from_secs(interval.into()) / POLLS;
        let thread = Builder::new()
            .name("keep-alive".to_owned())
            .stack_size(STACK)
            .spawn(move || {
                while stopped.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                    match shared.try_lock() {
                        Ok(mut connection) => connection.keep(),
                        Err(TryLockError::Poisoned(_)) => return,
                        Err(TryLockError::WouldBlock) => {}
                    }
                }
            });
        if let Err(error) = &thread {
            log::warn!(
                "could not start the thread that keeps the connection alive during long steps: {error}"
            );
        }
        Self {
            connection,
            stop,
            thread: thread.ok(),
        }
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, BufferedConnection> {
        self.connection
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the thread and closes the connection, see [`Connection::close`].
    pub(super) fn close(self, timeout: Duration) {
        drop(self.stop);
        if self.thread.is_some_and(|thread| thread.join().is_err()) {
            log::error!("the thread that keeps the connection alive panicked");
        }
        if let Some(shared) = Arc::into_inner(self.connection) {
            let buffered = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
            buffered.connection.close(timeout);
        }
    }
}
