//! The MQTT connection of the optimization tool and of the simulation wrapper.
//!
//! The packets are those of the crate `swarmwright-packets`, which the embedded broker reads and writes too. This crate adds the
//! state of a connection (`session`), the socket (TCP, TLS,
//! websocket, Unix socket), the event loop on one thread without locks, and reconnection. One `poll` sends everything that was
//! published since the last in one write, since a step of many agents is many small messages.

#[cfg(test)]
#[global_allocator]
static MEMORY: swarmwright_fuzzing::Counting = swarmwright_fuzzing::Counting;

mod accounts;
mod connection;
mod dialect;
mod handshake;
mod probe;
mod publication;
mod reading;
mod session;
mod settings;
mod tls;
mod transport;
#[cfg(unix)]
mod unix;

pub use accounts::{Published, UserAndPassword};
pub use connection::{Connection, Event, TooLarge, Traffic, Waker};
pub use probe::holds_back_small_packets;
pub use publication::PublishOptions;
pub use session::{Incoming, QoS, Subscription, Version};
pub use settings::{BrokerUrl, ClientCertificate, Scheme, Settings, SettingsError, Will};

/// Attempts for a connection that the broker accepts and then closes.
const MOST_TRIES: u32 = 5;

/// Why no connection to the broker could be established.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// No process listens at the address.
    #[error(
        "no broker answers at {url} ({reason}); start one with `swarmwright broker`, or name another with --broker URL"
    )]
    NoBroker {
        /// Where.
        url: String,
        /// What the system says.
        reason: String,
    },
    /// A process listens at the address, but it is not an MQTT broker.
    #[error(
        "the server at {url} is not an MQTT broker ({reason}); check scheme and port of the URL"
    )]
    NoMqtt {
        /// Where.
        url: String,
        /// What happened.
        reason: String,
    },
    /// The broker closes connections that it has just accepted.
    #[error(
        "the broker at {url} accepted the connection and closed it before it answered the subscription ({reason}), {MOST_TRIES} \
         times in a row; its log may contain the cause"
    )]
    Broken {
        /// Where.
        url: String,
        /// What happened.
        reason: String,
    },
    /// The broker refuses the credentials.
    #[error(
        "the broker at {url} refuses {user} ({reason}); set SWARMWRIGHT_USERNAME and SWARMWRIGHT_PASSWORD \
         (or SWARMWRIGHT_PASSWORD_FILE) to an account of that broker, such as `swarmwright broker --account FILE` writes"
    )]
    Refused {
        /// Where.
        url: String,
        /// The user, or "a client without a user name".
        user: String,
        /// The broker's reason.
        reason: String,
    },
    /// The broker accepts no further connections at present.
    #[error(
        "the broker at {url} is busy ({reason}), {MOST_TRIES} times in a row; the account is not the cause. Try again in a \
         minute, as --wait SECONDS does"
    )]
    Busy {
        /// Where.
        url: String,
        /// The broker's reason.
        reason: String,
    },
    /// The system does not let this user open the broker's Unix socket.
    #[error(
        "this user may not open the broker's socket {url} (permission denied); its file must be writable and the folders of \
         its path accessible for this user: the built-in broker has --socket-mode, others a umask or a group"
    )]
    Forbidden {
        /// Where.
        url: String,
    },
    /// The broker denies this client a subscription.
    #[error(
        "the broker at {url} does not let {user} subscribe to {filter:?} ({reason}); correct the broker's access rules, or set the \
         topic prefix that this account belongs to (--prefix, SWARMWRIGHT_PREFIX)"
    )]
    Denied {
        /// Where.
        url: String,
        /// The user, or "a client without a user name".
        user: String,
        /// The topic filter.
        filter: String,
        /// The broker's reason.
        reason: String,
    },
    /// The broker denies this client messages on a topic.
    #[error(
        "the broker at {url} does not let {user} publish on {topic:?} ({reason}); correct the broker's access rules, or set the topic \
         prefix that this account belongs to (--prefix, SWARMWRIGHT_PREFIX)"
    )]
    Unpublishable {
        /// Where.
        url: String,
        /// The user, or "a client without a user name".
        user: String,
        /// The topic.
        topic: String,
        /// The broker's reason.
        reason: String,
    },
    /// The certificates do not fit.
    #[error("no secure connection to {url}: {reason}")]
    Tls {
        /// Where.
        url: String,
        /// What does not fit, and how to fix it.
        reason: String,
    },
}

impl ConnectError {
    /// The error of several brokers of which none can be used: the first that is there and refuses, if there is one.
    fn all(mut errors: Vec<Self>) -> Self {
        if let Some(index) = errors
            .iter()
            .position(|error| !matches!(error, Self::NoBroker { .. }))
        {
            return errors.swap_remove(index);
        }
        let (urls, reasons): (Vec<_>, Vec<_>) = errors
            .into_iter()
            .filter_map(|error| match error {
                Self::NoBroker { url, reason } => Some((url, reason)),
                _ => None,
            })
            .unzip();
        Self::NoBroker {
            url: urls.join(" or "),
            reason: reasons.join("; "),
        }
    }
}
