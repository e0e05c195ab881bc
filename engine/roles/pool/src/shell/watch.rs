//! Monitoring: servers and tools on the broker.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use swarmwright_mqtt::{Connection, Event, QoS, Settings, Subscription};
use swarmwright_protocol::{Message, Presence, Status, Topic, Topics};

use crate::shell::error::PoolError;

/// A message that a watcher received.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// State of a server.
    Presence(Box<Presence>),
    /// A server left in an orderly way.
    Left(u64),
    /// Status of a tool, with the token that identifies the tool.
    Status(String, Box<Status>),
    /// The connection to the broker was restored, or lost for this reason.
    Broker(Result<(), String>),
}

/// Longest wait for messages on one of the two connections before the other one is read.
const TURN: Duration = Duration::from_millis(20);

/// A connection that only receives.
pub struct Watcher {
    connection: Connection,
    topics: Topics,
    events: Vec<Event>,
}

impl Watcher {
    /// Connects; `tools`: whether to receive the statuses of tools as well as the presence of servers.
    ///
    /// # Errors
    /// Fails if the broker is unreachable or refuses the credentials, or if the prefix is invalid.
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

    /// Converts an event; other messages are ignored.
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
            // A retained status is left over from an earlier run.
            Message::Status(status) if !message.retained() => {
                Some(News::Status(last().to_owned(), status))
            }
            _ => None,
        }
    }

    /// Disconnects.
    pub fn close(self) {
        self.connection.close(Duration::from_secs(1));
    }
}

/// Returns the presence of all servers on the broker, by id: retained messages, and those that arrive within `wait`.
///
/// # Errors
/// Fails if the broker is unreachable or refuses the credentials, or if the prefix is invalid.
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

/// Removes the retained presence of servers. Returns the servers whose removal the broker has published within `wait`;
/// others are kept, for example because the broker disconnects an account that may not publish presence.
///
/// # Errors
/// Fails if the broker is unreachable, refuses the credentials or reports that it denies the removal, or if the prefix
/// is invalid.
pub fn forget_servers(
    settings: Settings,
    prefix: &str,
    servers: &[u64],
    wait: Duration,
) -> Result<Vec<u64>, PoolError> {
    // A connection does not receive its own messages.
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
