//! Socket of a connection: opening, waiting, reading, writing, and reopening.

use std::io::ErrorKind;
use std::time::{Duration, Instant};

use mio::Interest;

use super::{Connection, Event, FIRST_PAUSE, Link, SOCKET};
use crate::ConnectError;
use crate::handshake::{self, Caller};
use crate::session::Received;

const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// Duration below which a connection counts as short-lived; the pause before the next one then grows.
const SHORT_LIVED: Duration = Duration::from_secs(2);
const MOST_DOUBLINGS: u32 = 7;

impl Connection {
    pub(super) fn reconnect(&mut self, events: &mut Vec<Event>) {
        if self.link.is_some() || Instant::now() < self.retry_at {
            return;
        }
        match self.establish(false) {
            Ok(()) => events.push(Event::Connected),
            Err(error) => {
                log::debug!("{error}");
                self.settings.next_broker();
                self.failures += 1;
                if self.failures <= self.settings.others.len() {
                    self.retry_at = Instant::now(); // Another broker of the cluster may be available.
                    return;
                }
                self.failures = 0;
                // Jitter, so that the servers of a cluster do not all reconnect at the same time.
                self.retry_at = Instant::now() + self.pause.mul_f64(0.5 + fastrand::f64());
                self.pause = (self.pause * 2).min(LONGEST_PAUSE);
            }
        }
    }

    /// Connects to the first reachable broker.
    pub(super) fn establish_any(&mut self) -> Result<(), ConnectError> {
        // With several brokers, try the next one instead of waiting.
        let mut errors = match self.establish(self.settings.others.is_empty()) {
            Err(error) if !self.settings.others.is_empty() => vec![error],
            result => return result,
        };
        for _ in 0..self.settings.others.len() {
            self.settings.next_broker();
            match self.establish(false) {
                Ok(()) => {
                    for error in errors {
                        log::warn!("{error}; {} is used instead", self.settings.url);
                    }
                    return Ok(());
                }
                Err(error) => errors.push(error),
            }
        }
        self.settings.next_broker();
        Err(ConnectError::all(errors))
    }

    /// Connects to the current broker; `waits`: also waits for it if it is restarting.
    fn establish(&mut self, waits: bool) -> Result<(), ConnectError> {
        let caller = Caller {
            settings: &self.settings,
            client_id: &self.client_id,
            subscriptions: &self.subscriptions,
            waits,
        };
        let (mut transport, session) =
            handshake::connect(&caller, &mut self.chunk, &mut self.out, &mut self.early)?;
        let failed = |error: std::io::Error| ConnectError::NoBroker {
            url: self.settings.url.to_string(),
            reason: error.to_string(),
        };
        transport.set_nonblocking().map_err(failed)?;
        self.poll
            .registry()
            .register(
                transport.socket(),
                SOCKET,
                Interest::READABLE | Interest::WRITABLE,
            )
            .map_err(failed)?;
        self.link = Some(Link {
            transport,
            session,
            readable: true,
            unacknowledged: true,
            closing: false,
        });
        self.opened = Instant::now();
        self.failures = 0;
        Ok(())
    }

    pub(super) fn wait(&mut self, until: Instant, events: &mut Vec<Event>) {
        // An answer carries the acknowledgement, so this system call is only needed if nothing was sent.
        if let Some(link) = &mut self.link
            && std::mem::take(&mut link.unacknowledged)
        {
            link.transport.acknowledge();
        }
        // Round up to the resolution of epoll, so that a wait never ends just before its time and spins.
        let timeout = until.saturating_duration_since(Instant::now());
        let timeout = if timeout.is_zero() {
            timeout
        } else {
            timeout + Duration::from_micros(999)
        };
        if let Err(error) = self.poll.poll(&mut self.mio_events, Some(timeout)) {
            if error.kind() != ErrorKind::Interrupted {
                self.broke(format!("the system's event queue failed: {error}"), events);
            }
            return;
        }
        for event in &self.mio_events {
            if event.token() == SOCKET
                && let Some(link) = &mut self.link
            {
                link.closing |= event.is_read_closed() || event.is_error();
                link.readable |= event.is_readable() || link.closing;
            }
        }
    }

    pub(super) fn flush(&mut self, events: &mut Vec<Event>) {
        let Some(link) = &mut self.link else { return };
        let mut sent = 0;
        let result = loop {
            if sent == self.out.len() {
                break link.transport.flush();
            }
            match link.transport.write(&self.out[sent..]) {
                Ok(count) => sent += count,
                Err(error) => break Err(error),
            }
        };
        self.out.drain(..sent);
        link.unacknowledged &= sent == 0;
        self.traffic.sent_bytes += sent as u64;
        match result {
            // If the socket is full, its becoming writable ends the next wait.
            Err(error)
                if !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
            {
                self.broke(error.to_string(), events);
            }
            _ => {}
        }
    }

    pub(super) fn read(&mut self, events: &mut Vec<Event>) {
        let Some(link) = self.link.as_mut().filter(|link| link.readable) else {
            return;
        };
        let count = match link.transport.read(&mut self.chunk) {
            Ok(0) => return self.broke("the broker closed the connection".to_owned(), events),
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                link.readable = false;
                return;
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => return,
            Err(error) => return self.broke(error.to_string(), events),
        };
        self.traffic.received_bytes += count as u64;
        link.unacknowledged = true;
        link.readable =
            count == self.chunk.len() || link.closing || !link.transport.short_read_is_all();
        let mut closed = None;
        let traffic = &mut self.traffic;
        let settings = &self.settings;
        link.session.receive(
            &self.chunk[..count],
            &mut self.out,
            &mut |received| match received {
                Received::Publish(message) => {
                    traffic.received_messages += 1;
                    events.push(Event::Message(message));
                }
                Received::Denied(topic, reason) => {
                    let error = ConnectError::Unpublishable {
                        url: settings.url.to_string(),
                        user: settings.who(),
                        topic: topic.clone(),
                        reason,
                    };
                    let message = error.to_string();
                    events.push(Event::Denied { topic, message });
                }
                Received::Closed(reason) | Received::Refused(reason, _) => closed = Some(reason),
                Received::Accepted | Received::Subscribed(_) => {}
            },
        );
        if let Some(reason) = closed {
            // Send the reason to the broker without waiting for it.
            let _ = link.transport.write(&self.out);
            let _ = link.transport.flush();
            self.broke(reason, events);
        }
    }

    pub(super) fn broke(&mut self, reason: String, events: &mut Vec<Event>) {
        if let Some(mut link) = self.link.take() {
            let _ = self.poll.registry().deregister(link.transport.socket());
            self.out.clear();
            // Back off from a broker that closes each new connection at once, as some do if they deny a message.
            self.short_lived = if self.opened.elapsed() < SHORT_LIVED {
                (self.short_lived + 1).min(MOST_DOUBLINGS)
            } else {
                0
            };
            self.pause = (FIRST_PAUSE * 2_u32.pow(self.short_lived)).min(LONGEST_PAUSE);
            self.retry_at = Instant::now() + self.pause.mul_f64(0.5 + fastrand::f64());
            let (_, unread) = link.session.read();
            events.push(Event::Disconnected { reason, unread });
        }
    }
}
