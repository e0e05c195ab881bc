//! Why a pool cannot do its work.

use swarmwright_mqtt::{ConnectError, SettingsError};
use swarmwright_protocol::TopicError;

use crate::work::WorkError;

/// Why the pool cannot do its work.
#[derive(Debug, thiserror::Error)]
pub enum PoolError {
    /// No connection to the broker.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The URL or the credentials cannot be used.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A prefix that cannot be used in a topic.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// No server fits, or all have gone.
    #[error("no server fits on {url} after {seconds:.0} s{outages}; {description}")]
    NoServer {
        /// The broker.
        url: String,
        /// How long was waited.
        seconds: f64,
        /// When the broker was not reachable meanwhile, in words; empty if it always was.
        outages: String,
        /// What was required and what was found.
        description: String,
        /// Whether there is no server at all, not even one that does not fit.
        nothing: bool,
        /// Titles that servers offer.
        titles: Vec<String>,
    },
    /// The broker was lost, and did not come back in time: whether a server fits is not known.
    #[error(
        "the broker on {url} was not reachable {outages}, so no server could be found or used; check that it runs and that this \
         machine reaches it (a run waits for it as long as the longer of timeouts.discovery and timeouts.step)"
    )]
    BrokerLost {
        /// The broker.
        url: String,
        /// From when to when it was not reachable, in words.
        outages: String,
    },
    /// The broker does not let this tool look for servers.
    #[error("{0}")]
    Denied(String),
    /// The servers do not say how many sensors and actuators there are.
    #[error(
        "the servers do not announce their numbers of sensors and actuators; add `sensors:` and `actuators:` to the experiment"
    )]
    NoSizes,
    /// Every server refuses the work.
    #[error("no server can do this work: {0}")]
    Rejected(String),
    /// Genomes that do not fit.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// A part of the work is larger than the broker takes.
    #[error("{0}")]
    TooLarge(String),
    /// Two servers do not find the same, and it cannot be told which one is wrong.
    #[error("servers disagree: {0}")]
    Disagreement(String),
    /// It cannot be told whether candidates or servers are at fault, or all servers are broken.
    #[error("{0}")]
    Hopeless(String),
    /// The caller requested to stop.
    #[error("interrupted")]
    Interrupted,
}
