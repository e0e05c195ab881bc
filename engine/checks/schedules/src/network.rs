//! Connections to a broker: what is under way on them keeps its order and is lost with them, as MQTT's QoS 0 over TCP.

use std::collections::BTreeMap;
use std::rc::Rc;

use crate::random::mix;
use crate::schedule::{Disturbance, MILLI, Time, What};

/// A message, a connection's beginning or its end.
#[derive(Debug, Clone)]
pub enum Packet {
    /// A message to or from the broker.
    Publish {
        /// The full name.
        topic: Rc<str>,
        /// What is said.
        payload: Rc<[u8]>,
        /// To the broker: to be retained. From it: was retained.
        retained: bool,
    },
    /// The broker has accepted the connection and all subscriptions.
    Accepted,
    /// A client's good-bye: no last will.
    Goodbye,
    /// The other end has closed the connection.
    Closed,
}

/// What a client wants to hear.
#[derive(Debug, Clone)]
pub enum Filter {
    /// A topic.
    Exactly(String),
    /// All topics that begin so.
    Below(String),
}

impl Filter {
    fn fits(&self, topic: &str) -> bool {
        match self {
            Self::Exactly(name) => name == topic,
            Self::Below(root) => topic.starts_with(root),
        }
    }
}

/// A last will.
pub type Will = (Rc<str>, Rc<[u8]>);

#[derive(Default)]
struct Lane {
    last: Time,
    /// When the last message on a topic comes.
    topics: BTreeMap<Rc<str>, Time>,
    count: u64,
}

/// A connection of a client, living or dead. Its two ends may hold different views of that.
pub struct Connection {
    /// Owner, an index among all parties.
    pub who: usize,
    /// Which start of the client it is.
    pub incarnation: u64,
    /// Whether the client holds it for open.
    pub client_open: bool,
    /// Whether the broker does.
    pub broker_open: bool,
    filters: Vec<Filter>,
    /// What the broker says when it ends without good-bye.
    pub will: Option<Will>,
    up: Lane,
    down: Lane,
}

/// The broker and all connections that there ever were.
pub struct Network {
    seed: u64,
    /// Whether there are servers that know only the seven topics.
    plain: bool,
    /// By number.
    pub connections: Vec<Connection>,
    /// Whether the broker runs.
    pub up: bool,
    /// What is retained, by topic.
    pub retained: BTreeMap<Rc<str>, Rc<[u8]>>,
    /// The retained messages of an earlier time.
    pub snapshot: BTreeMap<Rc<str>, Rc<[u8]>>,
}

/// A packet that arrives at a time.
pub struct Transfer {
    /// When.
    pub at: Time,
    /// On which connection.
    pub connection: usize,
    /// Whether to the broker.
    pub up: bool,
    /// What.
    pub packet: Packet,
}

impl Network {
    /// A broker without clients.
    #[must_use]
    pub fn new(seed: u64, plain: bool) -> Self {
        Self {
            seed,
            plain,
            connections: Vec::new(),
            up: true,
            retained: BTreeMap::new(),
            snapshot: BTreeMap::new(),
        }
    }

    /// A new connection with its subscriptions; its number.
    pub fn open(
        &mut self,
        peer: usize,
        incarnation: u64,
        filters: Vec<Filter>,
        will: Option<Will>,
    ) -> usize {
        self.connections.push(Connection {
            who: peer,
            incarnation,
            client_open: true,
            broker_open: true,
            filters,
            will,
            up: Lane::default(),
            down: Lane::default(),
        });
        self.connections.len() - 1
    }

    /// What a new connection is sent at once: the acknowledgement and all that is retained for it.
    #[must_use]
    pub fn welcome(&self, connection: usize) -> Vec<Packet> {
        let filters = &self.connections[connection].filters;
        let retained = self
            .retained
            .iter()
            .filter(|(topic, _)| filters.iter().any(|filter| filter.fits(topic)));
        std::iter::once(Packet::Accepted)
            .chain(retained.map(|(topic, payload)| Packet::Publish {
                topic: Rc::clone(topic),
                payload: Rc::clone(payload),
                retained: true,
            }))
            .collect()
    }

    /// The broker takes a message; the connections that are to get it.
    pub fn route(&mut self, topic: &Rc<str>, payload: &Rc<[u8]>, retain: bool) -> Vec<usize> {
        if retain {
            if payload.is_empty() {
                self.retained.remove(topic);
            } else {
                self.retained.insert(Rc::clone(topic), Rc::clone(payload));
            }
        }
        let hears = |connection: &Connection| {
            connection.broker_open && connection.filters.iter().any(|filter| filter.fits(topic))
        };
        let all = self.connections.iter().enumerate();
        all.filter(|(_, connection)| hears(connection))
            .map(|(number, _)| number)
            .collect()
    }

    /// Puts a packet on its way, `extra` after now. `disturbances`: those that hit the client now.
    pub fn transmit(
        &mut self,
        connection: usize,
        up: bool,
        packet: &Packet,
        leaves: Time,
        disturbances: &[(u64, Disturbance)],
    ) -> Vec<Transfer> {
        let link = &mut self.connections[connection];
        let peer = link.who as u64;
        let lane = if up { &mut link.up } else { &mut link.down };
        lane.count += 1;
        let draw = |salt: u64, limit: u64| {
            mix(&[
                self.seed,
                salt,
                peer,
                u64::from(up),
                link.incarnation,
                lane.count,
            ])
            .checked_rem(limit)
            .unwrap_or(0)
        };
        let latency = match draw(0, 64) {
            0 => draw(1, 30 * MILLI),
            _ => 40 + draw(1, MILLI),
        };
        let mut at = leaves + latency;
        let (mut ordered, mut within_topic, mut again) = (true, true, None);
        // The end of a connection is seen to by TCP, and presence goes with QoS 1.
        // Nothing in the messages of single steps tells a double from a new one, and nothing tells the two answers of a
        // plain server to a double from those of two servers.
        let numbered = match packet {
            Packet::Publish { topic, .. } => match &**topic {
                "sensor" | "actuator" => false,
                "server" | "discovery" => !self.plain,
                _ => true,
            },
            _ => false,
        };
        let fragile =
            matches!(packet, Packet::Publish { topic, .. } if !topic.contains("presence"));
        for (index, disturbance) in disturbances {
            let hit = |percent: u64| fragile && draw(100 + 10 * index, 100) < percent;
            let amount = |most: u64| draw(101 + 10 * index, most + 1);
            match disturbance.what {
                What::Lose { percent, .. } if hit(percent) => return Vec::new(),
                What::Duplicate { percent, later, .. } if hit(percent) && numbered => {
                    again = Some(amount(later))
                }
                What::Reorder { percent, later, .. } if hit(percent) => {
                    at += amount(later);
                    (ordered, within_topic) = (false, false);
                }
                What::Cross { percent, later, .. } if hit(percent) => {
                    at += amount(later);
                    ordered = false;
                }
                What::Delay { by, .. } => at += by,
                _ => {}
            }
        }
        if ordered {
            at = at.max(lane.last + 1);
            lane.last = at;
        }
        if let Packet::Publish { topic, .. } = packet
            && within_topic
        {
            let last = lane.topics.entry(Rc::clone(topic)).or_default();
            at = at.max(*last + 1);
            *last = at;
        }
        let transfer = |at| Transfer {
            at,
            connection,
            up,
            packet: packet.clone(),
        };
        std::iter::once(at)
            .chain(again.map(|later| at + 1 + later))
            .map(transfer)
            .collect()
    }
}
