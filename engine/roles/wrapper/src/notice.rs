//! Actions that a server's machine requests, and notices for its operator.

use std::fmt;

use swarmwright_protocol::Topic;
use swarmwright_worlds::Scene;

use crate::job::Job;

/// An action that the machine requests.
#[derive(Debug)]
pub enum Action {
    /// Publish with QoS 0; or, for presence, QoS 1 and retained.
    Publish(Topic, Vec<u8>),
    /// Publish the answer to a request, QoS 0, with the media type of extension messages.
    Reply {
        /// Topic without prefix.
        topic: String,
        /// Number of the request, sent as correlation data in 8 bytes, big-endian; `None` if no request is answered.
        request: Option<u64>,
        /// Payload of the message.
        payload: Vec<u8>,
    },
    /// Compute a job on any thread, and pass the result to [`Machine::finished`](crate::Machine::finished).
    Evaluate(Job),
    /// Leave the broker for good without publishing that this id left, because another server has it. Ignored if that
    /// server is known to be dead: a broker that was killed keeps the presence of servers that ended with it.
    GiveWay(Rival),
    /// Notify the operator.
    Notice(Notice),
    /// Show a frame of the run.
    Frame(Scene),
}

/// Another server with the same id, as far as it is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rival {
    /// The id.
    pub id: u64,
    /// Name of its machine.
    pub host: Option<String>,
    /// Process id on that machine.
    pub pid: Option<u64>,
}

impl fmt::Display for Rival {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str(self.host.as_deref().unwrap_or("an unknown host"))?;
        match self.pid {
            Some(pid) => write!(formatter, ", process {pid}"),
            None => Ok(()),
        }
    }
}

/// A notice for the operator of a server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice {
    /// The server is free.
    Ready,
    /// The server is taken, by the named tool if it gave a name.
    Busy(Option<String>),
    /// A warning.
    Warning(String),
    /// The connection to the broker was lost; the server reconnects.
    Lost(String),
}

impl fmt::Display for Notice {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Ready => formatter.write_str("ready"),
            Self::Busy(Some(tool)) => write!(formatter, "busy for {tool}"),
            Self::Busy(None) => formatter.write_str("busy"),
            Self::Warning(text) => write!(formatter, "warning: {text}"),
            Self::Lost(reason) => write!(formatter, "lost the broker: {reason}"),
        }
    }
}
