//! Extension: presence, a retained message per server with its current state (docs/reference/protocol.md).

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use crate::numbers::Id;
use crate::place;
use crate::{Capabilities, DecodeError, MAX_PAYLOAD};

/// State of a server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// The server answers discoveries.
    Ready,
    /// An optimization tool has the server.
    Busy,
    /// The server's connection broke; set by the last will.
    Lost,
}

/// A server's retained presence message.
#[derive(Debug, Clone, PartialEq)]
pub struct Presence {
    /// Id of the server.
    pub server: u64,
    /// State of the server.
    pub state: State,
    /// Titles of the offered simulations.
    pub simulations: Vec<String>,
    /// Capabilities, including the announcement of host, process and instance.
    pub capabilities: Capabilities,
    /// Tool that holds the server, if it is busy and the tool is known.
    pub tool: Option<String>,
    /// Start of this state, in RFC 3339.
    pub since: String,
}

#[derive(Serialize, Deserialize)]
struct Wire {
    version: Id,
    server: Id,
    #[serde(deserialize_with = "state")]
    state: State,
    simulations: Vec<String>,
    capabilities: Map<String, Value>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    tool: Option<String>,
    since: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    host: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pid: Option<u64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    instance: Option<String>,
}

/// Reads a state from a string only; serde would also accept an object, and mention it in errors.
fn state<'de, D: Deserializer<'de>>(deserializer: D) -> Result<State, D::Error> {
    match String::deserialize(deserializer)?.as_str() {
        "ready" => Ok(State::Ready),
        "busy" => Ok(State::Busy),
        "lost" => Ok(State::Lost),
        other => Err(D::Error::unknown_variant(other, &["ready", "busy", "lost"])),
    }
}

impl Presence {
    pub(crate) fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        if payload.len() > MAX_PAYLOAD {
            return Err(DecodeError::TooLarge {
                bytes: payload.len(),
                most: MAX_PAYLOAD,
            });
        }
        let object: Map<String, Value> = serde_json::from_slice(payload)?;
        let wire: Wire = place::read(Value::Object(object), "")?;
        if wire.version != Id(1) {
            return Err(DecodeError::value(format!(
                "\"version\" is {}, expected 1",
                wire.version.0
            )));
        }
        let mut capabilities = Capabilities::from_object(wire.capabilities)?;
        if let Some(announced) = &mut capabilities.swarmwright {
            announced.host = announced.host.take().or(wire.host);
            announced.pid = announced.pid.or(wire.pid);
            announced.instance = announced.instance.take().or(wire.instance);
        }
        Ok(Self {
            server: wire.server.0,
            state: wire.state,
            simulations: wire.simulations,
            capabilities,
            tool: wire.tool,
            since: wire.since,
        })
    }

    /// Encodes the payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let announcement = self.capabilities.swarmwright.clone();
        let capabilities = match self.capabilities.to_value() {
            Value::Object(object) => object,
            _ => Map::new(),
        };
        let wire = Wire {
            version: Id(1),
            server: Id(self.server),
            state: self.state,
            simulations: self.simulations.clone(),
            capabilities,
            tool: self.tool.clone(),
            since: self.since.clone(),
            host: announcement.as_ref().and_then(|a| a.host.clone()),
            pid: announcement.as_ref().and_then(|a| a.pid),
            instance: announcement.and_then(|a| a.instance),
        };
        // Strings and integers cannot fail to serialize.
        serde_json::to_vec(&wire).unwrap_or_default()
    }
}
