//! Errors of a pool.

use swarmwright_mqtt::{ConnectError, SettingsError};
use swarmwright_protocol::TopicError;

use crate::work::WorkError;

/// The error type of a pool.
#[derive(Debug, thiserror::Error)]
pub enum PoolError {
    /// The connection to the broker could not be established.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The URL or the credentials are invalid.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The prefix cannot be used in a topic.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// No server fits, or all have left.
    #[error("no server fits on {url} after {seconds:.0} s{outages}; {description}")]
    NoServer {
        /// URL of the broker.
        url: String,
        /// Seconds waited.
        seconds: f64,
        /// When the broker was not reachable, for users; empty if it always was.
        outages: String,
        /// The required and the found servers.
        description: String,
        /// Whether there is no server at all, not even one that does not fit.
        nothing: bool,
        /// Titles that the servers offer.
        titles: Vec<String>,
    },
    /// The broker was lost and did not return in time, so it is unknown whether a server fits.
    #[error(
        "the broker on {url} was not reachable {outages}, so no server could be found or used; check that it runs and that this \
         machine reaches it (a run waits for it as long as the longer of timeouts.discovery and timeouts.step)"
    )]
    BrokerLost {
        /// URL of the broker.
        url: String,
        /// When the broker was not reachable, for users.
        outages: String,
    },
    /// The broker denies the discovery of servers.
    #[error("{0}")]
    Denied(String),
    /// The servers do not announce their numbers of sensors and actuators.
    #[error(
        "the servers do not announce their numbers of sensors and actuators; add `sensors:` and `actuators:` to the experiment"
    )]
    NoSizes,
    /// Every server refuses the work.
    #[error("no server can do this work: {0}")]
    Rejected(String),
    /// The genomes do not match the controllers.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// A part of the work is larger than the broker accepts.
    #[error("{0}")]
    TooLarge(String),
    /// Two servers disagree, and it is unknown which one is wrong.
    #[error("servers disagree: {0}")]
    Disagreement(String),
    /// It is undecidable whether candidates or servers are at fault, or all servers are broken.
    #[error("{0}")]
    Hopeless(String),
    /// The caller requested a stop.
    #[error("interrupted")]
    Interrupted,
}
