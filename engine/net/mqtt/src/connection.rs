//! The event loop: one socket, one thread, reconnection.

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
    /// Connected again and subscribed again; what was published meanwhile is lost.
    Connected,
    /// The connection broke; attempts to reconnect follow.
    Disconnected {
        /// Why.
        reason: String,
        /// Bytes of the largest packet that was sent and that the broker is not known to have read, where it is larger
        /// than all that it read, and than 1024: the broker may not accept packets of that size. 0 for none, and where the
        /// broker announces a limit.
        unread: usize,
    },
    /// A message was received.
    Message(Incoming),
    /// The broker does not distribute what is published on a topic. Brokers of MQTT 5 say so of each message at
    /// [`QoS::AtLeastOnce`], as the first one on a topic is.
    Denied {
        /// The topic.
        topic: String,
        /// What is wrong and how to fix it.
        message: String,
    },
}

/// A message that is larger than the broker accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLarge {
    /// Size of its packet in bytes.
    pub bytes: usize,
    /// What the broker accepts.
    pub most: usize,
}

/// What a connection has sent and received since it was first opened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes sent, without those of TLS.
    pub sent_bytes: u64,
    /// Bytes received, without those of TLS.
    pub received_bytes: u64,
    /// Messages published.
    pub sent_messages: u64,
    /// Messages received.
    pub received_messages: u64,
}

/// Ends a `poll` of another thread.
#[derive(Clone)]
pub struct Waker(Arc<mio::Waker>);

impl Waker {
    /// Makes the poll that waits, or the next one, return.
    pub fn wake(&self) {
        if let Err(error) = self.0.wake() {
            log::error!("cannot wake the MQTT thread: {error}");
        }
    }
}

struct Link {
    transport: Transport,
    session: Session,
    /// The socket may have more to read; cleared when a read says otherwise.
    readable: bool,
    /// Bytes were read since the last were sent, so they have not been acknowledged.
    unacknowledged: bool,
    /// The broker has closed its side: the end follows the last bytes, without a further event.
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
    /// When the connection was made that is used, or was used last.
    opened: Instant,
    /// Connections in a row that broke soon.
    short_lived: u32,
    out: Vec<u8>,
    retry_at: Instant,
    pause: Duration,
    /// Brokers that could not be reached, one after the other.
    failures: usize,
    chunk: Box<[u8]>,
    /// Events from while the connection was being established: retained messages follow the subscription at once.
    early: Vec<Event>,
    traffic: Traffic,
}

impl Connection {
    /// Connects and subscribes; MQTT 5, or 3.1.1 where the broker does not support it. Where the settings name several
    /// brokers of a cluster, the first that can be reached is used, and the next one when it is lost.
    ///
    /// # Errors
    /// Of all brokers: none at the address, no MQTT, credentials refused, a subscription denied, certificates that are not valid for it.
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

    /// A handle by which other threads end a `poll`.
    #[must_use]
    pub fn waker(&self) -> Waker {
        self.waker.clone()
    }

    /// The version of MQTT spoken; none while the connection is broken.
    #[must_use]
    pub fn version(&self) -> Option<Version> {
        self.link.as_ref().map(|link| link.session.version())
    }

    /// The broker's address, for messages.
    #[must_use]
    pub fn url(&self) -> String {
        self.settings.url.to_string()
    }

    /// What it has sent and received.
    #[must_use]
    pub fn traffic(&self) -> Traffic {
        self.traffic
    }

    /// Bytes of the largest packet that the broker accepts; `usize::MAX` if it announces no limit (MQTT 3.1.1), or is disconnected.
    #[must_use]
    pub fn largest_packet(&self) -> usize {
        self.link
            .as_ref()
            .map_or(usize::MAX, |link| link.session.largest())
    }

    /// Bytes of the largest packet that this connection has sent since it was opened last and the broker has read,
    /// where that is more than 1024 and the broker announces no limit; otherwise 0.
    #[must_use]
    pub fn largest_read(&self) -> usize {
        self.link.as_ref().map_or(0, |link| link.session.read().0)
    }

    /// Replaces the last will, from the next connection on.
    pub fn set_will(&mut self, will: crate::Will) {
        self.settings.will = Some(will);
    }

    /// Queues a message; `poll` sends it. While the connection is broken it is dropped: the peers of a broken
    /// connection start over (see the pool and the wrapper).
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

    /// As [`publish_with`](Self::publish_with); a message that is too large is logged.
    pub fn publish_logged(&mut self, topic: &str, payload: &[u8], options: &PublishOptions<'_>) {
        if let Err(TooLarge { bytes, most }) = self.publish_with(topic, payload, options) {
            log::error!(
                "{topic:?}: {bytes} bytes are more than the {most} that the broker accepts"
            );
        }
    }

    /// As [`publish`](Self::publish), with the properties of MQTT 5.
    ///
    /// # Errors
    /// It is larger than the broker accepts; it is not sent.
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

    /// Sends what is queued and waits for messages until `until` or a wake-up, whichever comes first.
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

    /// Disconnects (without last will) and closes, once the broker has read what was queued, or after `timeout`.
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
        // The broker closes once it has read the DISCONNECT. To close before, with bytes unread here, would reset the
        // connection, and what the broker has not read yet would be lost.
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
