//! The MQTT connection of the optimization tool and of the simulation wrapper.
//!
//! The protocol itself is the crate `mqtt-protocol-core`, which does no I/O; the one packet that comes by the million
//! is read and written by hand (`plain`). Here are the socket (TCP, TLS,
//! websocket), the event loop on one thread without locks, and reconnection. One `poll` sends everything that was
//! published since the last in one write, since a step of many agents is many small messages.

mod connection;
mod handshake;
mod manner;
mod plain;
mod probe;
mod publication;
mod reading;
mod session;
mod settings;
mod tls;
mod transport;

pub use connection::{Connection, Event, TooLarge, Traffic, Waker};
pub use probe::holds_back_small_packets;
pub use publication::PublishOptions;
pub use session::{Incoming, QoS, Subscription, Version};
pub use settings::{BrokerUrl, Scheme, Settings, SettingsError, Will};

/// How often a connection is tried that the broker accepts and then breaks.
const MOST_TRIES: u32 = 5;

/// Why no connection to the broker came about.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// Nobody listens there.
    #[error(
        "no broker answers at {url} ({reason}); start one with `swarmwright broker`, or name another with --broker URL"
    )]
    NoBroker {
        /// Where.
        url: String,
        /// What the system says.
        reason: String,
    },
    /// Somebody listens, and does not speak MQTT.
    #[error("what listens at {url} is no MQTT broker ({reason}); check scheme and port of the URL")]
    NoMqtt {
        /// Where.
        url: String,
        /// What happened.
        reason: String,
    },
    /// A broker listens there that breaks connections which it has just accepted.
    #[error(
        "the broker at {url} accepted the connection and broke it before it answered the subscription ({reason}), {MOST_TRIES} \
         times in a row; its log may tell why"
    )]
    Broken {
        /// Where.
        url: String,
        /// What happened.
        reason: String,
    },
    /// The broker wants other credentials.
    #[error(
        "the broker at {url} refuses {who} ({reason}); set SWARMWRIGHT_USERNAME and SWARMWRIGHT_PASSWORD \
         (or SWARMWRIGHT_PASSWORD_FILE) to an account of that broker"
    )]
    Refused {
        /// Where.
        url: String,
        /// The user, or "a client without a user name".
        who: String,
        /// The broker's reason.
        reason: String,
    },
    /// The broker takes nobody new for now.
    #[error(
        "the broker at {url} is busy ({reason}), {MOST_TRIES} times in a row; nothing is wrong with the account. Come again in a \
         minute, as --wait SECONDS does"
    )]
    Busy {
        /// Where.
        url: String,
        /// The broker's reason.
        reason: String,
    },
    /// The broker does not let this client read a topic.
    #[error(
        "the broker at {url} does not let {who} subscribe to {filter:?} ({reason}); mend its access control list"
    )]
    Denied {
        /// Where.
        url: String,
        /// The user, or "a client without a user name".
        who: String,
        /// The topic filter.
        filter: String,
        /// The broker's reason.
        reason: String,
    },
    /// The certificates do not fit.
    #[error("no secure connection to {url}: {reason}")]
    Tls {
        /// Where.
        url: String,
        /// What does not fit, and how to mend it.
        reason: String,
    },
}
