//! Looking on: who is on the broker, and what they say of themselves.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use swarmwright_mqtt::{Connection, Event, QoS, Settings, Subscription};
use swarmwright_protocol::{Message, Presence, Status, Topic, Topics};

use crate::shell::error::PoolError;

/// Something that a watcher heard.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// What a server does now.
    Presence(Box<Presence>),
    /// A server left cleanly.
    Left(u64),
    /// How a tool stands; its token tells it from others.
    Status(String, Box<Status>),
    /// The broker is back, or lost with this reason.
    Broker(Result<(), String>),
}

/// Longest wait for messages on one of the two connections before the other one is read.
const TURN: Duration = Duration::from_millis(20);

/// A connection that publishes nothing.
pub struct Watcher {
    connection: Connection,
    topics: Topics,
    events: Vec<Event>,
}

impl Watcher {
    /// Connects; `tools`: whether tools are listened to, or servers alone.
    ///
    /// # Errors
    /// No broker, refused credentials, or an invalid prefix.
    pub fn connect(settings: Settings, prefix: &str, tools: bool) -> Result<Self, PoolError> {
        let topics = Topics::new(prefix)?;
        let at = |filter, qos| Subscription { filter, qos };
        let mut subscriptions = vec![at(topics.presence_filter(), QoS::AtLeastOnce)];
        if tools {
            subscriptions.push(at(topics.status_filter(), QoS::AtMostOnce));
        }
        Ok(Self {
            connection: Connection::open(settings, subscriptions)?,
            topics,
            events: Vec::new(),
        })
    }

    /// Returns the messages until `until`, or as soon as there is one.
    pub fn poll(&mut self, until: Instant) -> Vec<News> {
        let mut news = Vec::new();
        while news.is_empty() && Instant::now() < until {
            self.connection.poll(until, &mut self.events);
            let events = std::mem::take(&mut self.events);
            news.extend(events.iter().filter_map(|event| self.read(event)));
        }
        news
    }

    /// What an event means; what is no message of ours is passed over.
    fn read(&self, event: &Event) -> Option<News> {
        let message = match event {
            Event::Connected => return Some(News::Broker(Ok(()))),
            Event::Disconnected { reason, .. } => return Some(News::Broker(Err(reason.clone()))),
            Event::Denied { .. } => return None,
            Event::Message(message) => message,
        };
        let topic = self.topics.parse(message.topic())?;
        let last = || message.topic().rsplit('/').next().unwrap_or_default();
        if topic == Topic::Presence && message.payload().is_empty() {
            return Some(News::Left(last().parse().ok()?));
        }
        match Message::decode(topic, message.payload()).ok()? {
            Message::Presence(presence) => Some(News::Presence(Box::new(presence))),
            // One that is retained is a leftover of an earlier run.
            Message::Status(status) if !message.retained() => {
                Some(News::Status(last().to_owned(), status))
            }
            _ => None,
        }
    }

    /// Leaves.
    pub fn close(self) {
        self.connection.close(Duration::from_secs(1));
    }
}

/// The presence of all servers on the broker, by id: what is retained, and what comes within `wait`.
///
/// # Errors
/// No broker, refused credentials, or an invalid prefix.
pub fn list_servers(
    settings: Settings,
    prefix: &str,
    wait: Duration,
) -> Result<Vec<Presence>, PoolError> {
    let mut watcher = Watcher::connect(settings, prefix, false)?;
    let deadline = Instant::now() + wait;
    let mut presences = BTreeMap::new();
    while Instant::now() < deadline {
        for news in watcher.poll(deadline) {
            match news {
                News::Presence(presence) => {
                    presences.insert(presence.server, *presence);
                }
                News::Left(server) => {
                    presences.remove(&server);
                }
                News::Status(..) | News::Broker(_) => {}
            }
        }
    }
    watcher.close();
    Ok(presences.into_values().collect())
}

/// Removes the presence of servers, which brokers retain. Returns those of which the broker has let it be known within
/// `wait`; others are kept, for example since it closes the connection of an account that may not publish presence.
///
/// # Errors
/// No broker, credentials refused, a prefix that cannot be; or the broker denies it, and says so.
pub fn forget_servers(
    settings: Settings,
    prefix: &str,
    servers: &[u64],
    wait: Duration,
) -> Result<Vec<u64>, PoolError> {
    // What a connection publishes itself is not sent back to it.
    let mut watcher = Watcher::connect(settings.clone(), prefix, false)?;
    let mut publisher = Connection::open(settings, Vec::new())?;
    for server in servers {
        let topic = watcher.topics.presence(*server);
        publisher.publish(&topic, &[], QoS::AtLeastOnce, true, None);
    }
    let deadline = Instant::now() + wait;
    let mut forgotten = Vec::new();
    let mut events = Vec::new();
    while forgotten.len() < servers.len() && Instant::now() < deadline {
        publisher.poll(Instant::now() + TURN, &mut events);
        for event in events.drain(..) {
            match event {
                Event::Denied { message, .. } => return Err(PoolError::Denied(message)),
                Event::Disconnected { .. } => return Ok(forgotten),
                _ => {}
            }
        }
        for news in watcher.poll(Instant::now() + TURN) {
            match news {
                News::Left(server) if servers.contains(&server) => forgotten.push(server),
                _ => {}
            }
        }
    }
    publisher.close(TURN);
    watcher.close();
    Ok(forgotten)
}
