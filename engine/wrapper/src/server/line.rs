//! The connection of a server, which is kept alive while simulations compute.

use std::ops::{Deref, DerefMut};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use swarmwright_mqtt::{Connection, Event};

/// Parts of the keep-alive interval after which the connection is looked at. The session asks the broker after half of
/// it at the latest, and expects the answer within the other half.
const LOOKS: u32 = 8;
/// More messages than these stay in the socket's buffers.
const MOST_KEPT: usize = 10_000;
const STACK: usize = 512 * 1024;

/// A connection, and what came while nobody waited for messages.
pub(super) struct Line {
    connection: Connection,
    kept: Vec<Event>,
    /// Whether a wake-up may have been used up.
    looked: bool,
}

impl Line {
    /// As the connection's `poll`; what was kept comes first.
    pub(super) fn poll(&mut self, until: Instant, events: &mut Vec<Event>) {
        events.append(&mut self.kept);
        let looked = std::mem::take(&mut self.looked);
        let until = if looked || !events.is_empty() {
            Instant::now()
        } else {
            until
        };
        self.connection.poll(until, events);
    }

    /// Answers and asks the broker. A connection that broke stays so: what the server computes now is lost with it.
    fn look(&mut self) {
        let broke = |event: &Event| matches!(event, Event::Disconnected { .. });
        if self.kept.len() < MOST_KEPT && !self.kept.iter().any(broke) {
            self.looked = true;
            self.connection.poll(Instant::now(), &mut self.kept);
        }
    }
}

impl Deref for Line {
    type Target = Connection;

    fn deref(&self) -> &Connection {
        &self.connection
    }
}

impl DerefMut for Line {
    fn deref_mut(&mut self) -> &mut Connection {
        &mut self.connection
    }
}

/// Looks at the connection while its owner does not, in a thread: a step of a simulation may take longer than the
/// keep-alive interval.
pub(super) struct Keeper {
    line: Arc<Mutex<Line>>,
    /// Ends the thread when it is dropped.
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Keeper {
    pub(super) fn new(connection: Connection, keep_alive: u16) -> Self {
        let line = Arc::new(Mutex::new(Line {
            connection,
            kept: Vec::new(),
            looked: false,
        }));
        let (stop, stopped) = mpsc::channel();
        let kept = Arc::clone(&line);
        let pause = Duration::from_secs(keep_alive.into()) / LOOKS;
        let thread = Builder::new()
            .name("keep-alive".to_owned())
            .stack_size(STACK)
            .spawn(move || {
                while stopped.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                    match kept.try_lock() {
                        Ok(mut line) => line.look(),
                        Err(TryLockError::Poisoned(_)) => return,
                        Err(TryLockError::WouldBlock) => {}
                    }
                }
            });
        if let Err(error) = &thread {
            log::warn!("no thread keeps the connection alive during long steps: {error}");
        }
        Self {
            line,
            stop: Some(stop),
            thread: thread.ok(),
        }
    }

    pub(super) fn line(&self) -> MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the thread and closes the connection, see [`Connection::close`].
    pub(super) fn close(mut self, timeout: Duration) {
        self.end();
        if let Some(line) = Arc::into_inner(self.line) {
            let line = line.into_inner().unwrap_or_else(PoisonError::into_inner);
            line.connection.close(timeout);
        }
    }

    fn end(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            log::error!("the thread that keeps the connection alive panicked");
        }
    }
}
