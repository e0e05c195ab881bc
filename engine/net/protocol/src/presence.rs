//! Extension: presence, a retained message per server that says what it does now (docs/reference/protocol.md).

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use crate::numbers::Id;
use crate::place;
use crate::{Capabilities, DecodeError, MAX_PAYLOAD};

/// What a server does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// It answers discovery.
    Ready,
    /// It is taken by an optimization tool.
    Busy,
    /// Its connection broke: the last will.
    Lost,
}

/// A server's retained presence message.
#[derive(Debug, Clone, PartialEq)]
pub struct Presence {
    /// The server's id.
    pub server: u64,
    /// What it does.
    pub state: State,
    /// Titles of the simulations that it offers.
    pub simulations: Vec<String>,
    /// What it can do, with the announcement of its host, process and instance.
    pub capabilities: Capabilities,
    /// The tool that holds it, if it is busy and the tool is known.
    pub tool: Option<String>,
    /// Since when, RFC 3339.
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

/// Reads a state from a string alone: serde would take an object, too, and say that it expects one.
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

    /// The payload.
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
