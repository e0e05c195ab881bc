//! The MQTT connection of the optimization tool and the simulation wrapper.
//!
//! The crate `swarmwright-packets`, which the embedded broker uses as well, encodes and decodes the packets. This crate
//! adds the state of a connection (`session`), the socket (TCP, TLS, WebSocket, Unix socket), an event loop on one
//! thread without locks, and reconnection. One `poll` sends all messages published since the last one in a single
//! write, since a step of many agents consists of many small messages.

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

/// Number of attempts if the broker accepts a connection and then closes it.
const MOST_TRIES: u32 = 5;

/// Reasons why no connection to the broker could be established.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// No process listens at the address.
    #[error(
        "no broker answers at {url} ({reason}); start one with `swarmwright broker`, or name another with --broker URL"
    )]
    NoBroker {
        /// URL of the broker.
        url: String,
        /// Error of the operating system.
        reason: String,
    },
    /// A process listens at the address, but it is not an MQTT broker.
    #[error(
        "the server at {url} is not an MQTT broker ({reason}); check scheme and port of the URL"
    )]
    NoMqtt {
        /// URL of the server.
        url: String,
        /// Description of the problem.
        reason: String,
    },
    /// The broker closes connections that it has just accepted.
    #[error(
        "the broker at {url} accepted the connection and closed it before it answered the subscription ({reason}), {MOST_TRIES} \
         times in a row; its log may contain the cause"
    )]
    Broken {
        /// URL of the broker.
        url: String,
        /// Description of the problem.
        reason: String,
    },
    /// The broker refuses the credentials.
    #[error(
        "the broker at {url} refuses {user} ({reason}); set SWARMWRIGHT_USERNAME and SWARMWRIGHT_PASSWORD \
         (or SWARMWRIGHT_PASSWORD_FILE) to an account of that broker, such as `swarmwright broker --account FILE` writes"
    )]
    Refused {
        /// URL of the broker.
        url: String,
        /// The user, or "a client without a user name".
        user: String,
        /// The broker's reason.
        reason: String,
    },
    /// The broker currently accepts no further connections.
    #[error(
        "the broker at {url} is busy ({reason}), {MOST_TRIES} times in a row; the account is not the cause. Try again in a \
         minute, as --wait SECONDS does"
    )]
    Busy {
        /// URL of the broker.
        url: String,
        /// The broker's reason.
        reason: String,
    },
    /// The operating system does not let this user open the broker's Unix socket.
    #[error(
        "this user may not open the broker's socket {url} (permission denied); its file must be writable and the folders of \
         its path accessible for this user: the built-in broker has --socket-mode, others a umask or a group"
    )]
    Forbidden {
        /// URL of the socket.
        url: String,
    },
    /// The broker denies this client a subscription.
    #[error(
        "the broker at {url} does not let {user} subscribe to {filter:?} ({reason}); correct the broker's access rules, or set the \
         topic prefix that this account belongs to (--prefix, SWARMWRIGHT_PREFIX)"
    )]
    Denied {
        /// URL of the broker.
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
        /// URL of the broker.
        url: String,
        /// The user, or "a client without a user name".
        user: String,
        /// The topic.
        topic: String,
        /// The broker's reason.
        reason: String,
    },
    /// The TLS handshake failed, for example because of the certificates.
    #[error("no secure connection to {url}: {reason}")]
    Tls {
        /// URL of the broker.
        url: String,
        /// Description of the problem, and how to fix it.
        reason: String,
    },
}

impl ConnectError {
    /// Returns the error for several brokers of which none can be used: that of the first reachable one that refuses,
    /// if there is one.
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
