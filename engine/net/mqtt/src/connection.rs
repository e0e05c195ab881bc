//! Event loop: one socket, one thread, and reconnection.

mod socket;

use std::io::ErrorKind;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mio::{Events, Poll, Token};

use crate::ConnectError;
use crate::publication::PublishOptions;
use crate::session::{Incoming, QoS, Received, Session, Subscription, Version};
use crate::settings::Settings;
use crate::transport::Transport;

const SOCKET: Token = Token(0);
const WAKER: Token = Token(1);
const CHUNK: usize = 1 << 16;
const FIRST_PAUSE: Duration = Duration::from_millis(100);

/// An event of the connection.
#[derive(Debug)]
pub enum Event {
    /// The connection and its subscriptions were restored; messages published in the meantime are lost.
    Connected,
    /// The connection broke; attempts to reconnect follow.
    Disconnected {
        /// Reason for the end of the connection.
        reason: String,
        /// Size in bytes of the largest packet sent that the broker may not have read, if it is larger than 1024 and
        /// than all packets known to be read: the broker may not accept packets of that size. 0 if there is none, or if
        /// the broker announces a limit.
        unread: usize,
    },
    /// A message was received.
    Message(Incoming),
    /// The broker denies messages on a topic. Brokers with MQTT 5 report this for each message with
    /// [`QoS::AtLeastOnce`], which the first one on a topic has.
    Denied {
        /// Topic of the message.
        topic: String,
        /// The problem, and how to fix it.
        message: String,
    },
}

/// A message that is larger than the broker accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLarge {
    /// Size of its packet in bytes.
    pub bytes: usize,
    /// Size in bytes of the largest packet that the broker accepts.
    pub most: usize,
}

/// Traffic of a connection since it was first opened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Number of bytes sent, without TLS overhead.
    pub sent_bytes: u64,
    /// Number of bytes received, without TLS overhead.
    pub received_bytes: u64,
    /// Number of messages published.
    pub sent_messages: u64,
    /// Number of messages received.
    pub received_messages: u64,
}

/// A handle that ends a `poll` of another thread.
#[derive(Clone)]
pub struct Waker(Arc<mio::Waker>);

impl Waker {
    /// Makes the current poll, or the next one, return.
    pub fn wake(&self) {
        if let Err(error) = self.0.wake() {
            log::error!("cannot wake the MQTT thread: {error}");
        }
    }
}

struct Link {
    transport: Transport,
    session: Session,
    /// Whether the socket may have more to read; cleared by a read that would block.
    readable: bool,
    /// Whether bytes were read since the last write, so that they have not been acknowledged.
    unacknowledged: bool,
    /// Whether the broker has closed its side: the end follows the last bytes, without a further event.
    closing: bool,
}

/// A connection to a broker that reconnects when it breaks.
pub struct Connection {
    settings: Settings,
    subscriptions: Vec<Subscription>,
    client_id: String,
    poll: Poll,
    waker: Waker,
    mio_events: Events,
    link: Option<Link>,
    /// When the current or most recent connection was established.
    opened: Instant,
    /// Number of short-lived connections in a row.
    short_lived: u32,
    out: Vec<u8>,
    retry_at: Instant,
    pause: Duration,
    /// Number of brokers in a row that could not be reached.
    failures: usize,
    chunk: Box<[u8]>,
    /// Events that arrived while the connection was established: retained messages follow the subscription at once.
    early: Vec<Event>,
    traffic: Traffic,
}

impl Connection {
    /// Connects and subscribes with MQTT 5, or with 3.1.1 if the broker does not support it. If the settings name
    /// several brokers of a cluster, the first reachable one is used, and the next one when it is lost.
    ///
    /// # Errors
    /// Fails if no broker can be used: it is unreachable, does not speak MQTT, refuses the credentials, denies a
    /// subscription, or has no valid certificate.
    pub fn open(
        settings: Settings,
        subscriptions: Vec<Subscription>,
    ) -> Result<Self, ConnectError> {
        let system = |error: std::io::Error| ConnectError::NoBroker {
            url: settings.url.to_string(),
            reason: format!("the operating system provides no event queue: {error}"),
        };
        let poll = Poll::new().map_err(system)?;
        let waker = Waker(Arc::new(
            mio::Waker::new(poll.registry(), WAKER).map_err(system)?,
        ));
        let mut connection = Self {
            client_id: format!("swarmwright-{:016x}", fastrand::u64(..)),
            settings,
            subscriptions,
            poll,
            waker,
            mio_events: Events::with_capacity(8),
            link: None,
            opened: Instant::now(),
            short_lived: 0,
            out: Vec::new(),
            retry_at: Instant::now(),
            pause: FIRST_PAUSE,
            failures: 0,
            chunk: vec![0; CHUNK].into_boxed_slice(),
            early: Vec::new(),
            traffic: Traffic::default(),
        };
        connection.establish_any()?;
        Ok(connection)
    }

    /// Returns a handle with which other threads end a `poll`.
    #[must_use]
    pub fn waker(&self) -> Waker {
        self.waker.clone()
    }

    /// Returns the version of MQTT in use; `None` while the connection is broken.
    #[must_use]
    pub fn version(&self) -> Option<Version> {
        self.link.as_ref().map(|link| link.session.version())
    }

    /// Returns the broker's URL, for messages.
    #[must_use]
    pub fn url(&self) -> String {
        self.settings.url.to_string()
    }

    /// Returns the traffic so far.
    #[must_use]
    pub fn traffic(&self) -> Traffic {
        self.traffic
    }

    /// Returns the size in bytes of the largest packet that the broker accepts; `usize::MAX` if it announces no limit,
    /// as with MQTT 3.1.1, or if the connection is broken.
    #[must_use]
    pub fn largest_packet(&self) -> usize {
        self.link
            .as_ref()
            .map_or(usize::MAX, |link| link.session.largest())
    }

    /// Returns the size in bytes of the largest packet on the current connection that the broker is known to have read,
    /// if it is larger than 1024 and the broker announces no limit; otherwise 0.
    #[must_use]
    pub fn largest_read(&self) -> usize {
        self.link.as_ref().map_or(0, |link| link.session.read().0)
    }

    /// Queues a message, which `poll` sends. It is dropped while the connection is broken, since peers start over after
    /// a broken connection (see the pool and the wrapper).
    pub fn publish(
        &mut self,
        topic: &str,
        payload: &[u8],
        qos: QoS,
        retain: bool,
        expiry: Option<u32>,
    ) {
        let options = PublishOptions {
            qos,
            retain,
            expiry,
            ..PublishOptions::default()
        };
        self.publish_logged(topic, payload, &options);
    }

    /// Like [`publish_with`](Self::publish_with); logs an error if the message is too large.
    pub fn publish_logged(&mut self, topic: &str, payload: &[u8], options: &PublishOptions<'_>) {
        if let Err(TooLarge { bytes, most }) = self.publish_with(topic, payload, options) {
            log::error!(
                "{topic:?}: {bytes} bytes are more than the {most} that the broker accepts"
            );
        }
    }

    /// Like [`publish`](Self::publish), with the properties of MQTT 5.
    ///
    /// # Errors
    /// Fails if the message is larger than the broker accepts; it is not sent.
    pub fn publish_with(
        &mut self,
        topic: &str,
        payload: &[u8],
        options: &PublishOptions<'_>,
    ) -> Result<(), TooLarge> {
        let Some(link) = &mut self.link else {
            return Ok(());
        };
        let (bytes, most) = (options.room(topic) + payload.len(), link.session.largest());
        if bytes > most {
            return Err(TooLarge { bytes, most });
        }
        self.traffic.sent_messages += 1;
        if let Err(error) = link.session.publish(topic, payload, options, &mut self.out) {
            log::error!(
                "cannot publish {} bytes on {topic:?}: {error}",
                payload.len()
            );
        }
        Ok(())
    }

    /// Sends queued messages and waits for incoming ones until `until` or a wake-up, whichever comes first.
    pub fn poll(&mut self, until: Instant, events: &mut Vec<Event>) {
        self.reconnect(events);
        events.append(&mut self.early);
        if self.link.is_none() || !events.is_empty() {
            self.wait(
                if events.is_empty() {
                    until.min(self.retry_at)
                } else {
                    Instant::now()
                },
                events,
            );
            return;
        }
        self.flush(events);
        let readable = self.link.as_ref().is_some_and(|link| link.readable);
        if !readable && events.is_empty() {
            let timer = self.link.as_ref().map(|link| link.session.next_timer());
            self.wait(timer.map_or(until, |timer| timer.min(until)), events);
        }
        self.read(events);
        let now = Instant::now();
        if let Some(link) = &mut self.link
            && link.session.next_timer() <= now
        {
            let mut closed = None;
            link.session.tick(now, &mut self.out, &mut |received| {
                if let Received::Closed(reason) = received {
                    closed = Some(reason);
                }
            });
            self.flush(events);
            if let Some(reason) = closed {
                self.broke(reason, events);
            }
        }
    }

    /// Disconnects without the last will, and closes once the broker has read the queued messages, or after `timeout`.
    pub fn close(mut self, timeout: Duration) {
        let deadline = Instant::now() + timeout;
        let mut events = Vec::new();
        if self.link.is_some() {
            Session::disconnect(&mut self.out);
        }
        while self.link.is_some() && !self.out.is_empty() && Instant::now() < deadline {
            self.flush(&mut events);
            if !self.out.is_empty() {
                self.wait(
                    deadline.min(Instant::now() + Duration::from_millis(10)),
                    &mut events,
                );
            }
        }
        // The broker closes after it has read the DISCONNECT. Closing earlier with unread bytes here would reset the
        // connection, and the broker would lose what it has not read yet.
        while let Some(link) = &mut self.link
            && Instant::now() < deadline
        {
            match link.transport.read(&mut self.chunk) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    self.flush(&mut events);
                    self.wait(deadline, &mut events);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Ok(0) | Err(_) => break,
                Ok(_) => {}
            }
        }
    }
}
