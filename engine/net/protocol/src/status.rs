//! Extension: status, what an optimization tool does now and what it waits for, for those who watch.
//!
//! Times are durations, in seconds: the clocks of a tool and of a watcher need not agree.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use crate::numbers::Id;
use crate::place;
use crate::{DecodeError, MAX_PAYLOAD};

/// Most entries of each list: a status of many servers stays far below [`MAX_PAYLOAD`].
pub const MOST_LISTED: usize = 1000;

/// What a tool does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activity {
    /// It looks for a first server.
    Looking,
    /// It has evaluations to be done.
    Evaluating,
    /// It leaves: its last status.
    Left,
}

/// In which piece work went to a server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PieceKind {
    /// One episode, stepwise.
    Episode,
    /// Several episodes, batched stepwise.
    Batch,
    /// Evaluations of which only the results come back.
    Block,
}

/// What of a piece has not come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Missing {
    /// Anything at all.
    Start,
    /// The sensors after the actuators of `step`.
    Sensors,
    /// The result.
    Result,
}

/// A piece of work under way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Waiting {
    /// Which server has it.
    #[serde(with = "id")]
    pub server: u64,
    /// In which piece it went there.
    pub kind: PieceKind,
    /// What has not come.
    pub missing: Missing,
    /// How many evaluations it is.
    #[serde(with = "id")]
    pub evaluations: u64,
    /// The agent whose actuators were not answered, of an episode.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_id")]
    pub agent: Option<u64>,
    /// The step whose actuators were not answered, from 0.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_id")]
    pub step: Option<u64>,
    /// Seconds since the server last said something of use.
    pub silent: f64,
}

impl fmt::Display for Waiting {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        let Self {
            server,
            evaluations,
            silent,
            ..
        } = self;
        let step = self.step.unwrap_or_default();
        write!(formatter, "server {server} has not ")?;
        match (self.kind, self.missing) {
            (PieceKind::Episode, Missing::Start) => write!(formatter, "begun its episode"),
            (PieceKind::Episode, Missing::Sensors) => {
                let agent = self.agent.unwrap_or_default();
                write!(
                    formatter,
                    "answered the actuators of agent {agent} in step {step}"
                )
            }
            (PieceKind::Episode, Missing::Result) => {
                write!(formatter, "sent the fitness of its episode")
            }
            (PieceKind::Batch, Missing::Start) => {
                write!(formatter, "begun its batch of {evaluations} episodes")
            }
            (PieceKind::Batch, Missing::Sensors) => write!(
                formatter,
                "answered the actuators of {evaluations} episodes in step {step}"
            ),
            (PieceKind::Batch, Missing::Result) => {
                write!(
                    formatter,
                    "sent the fitness of its batch of {evaluations} episodes"
                )
            }
            (PieceKind::Block, _) => {
                write!(formatter, "answered a block of {evaluations} evaluations")
            }
        }?;
        write!(formatter, " for {silent:.1} s")
    }
}

/// A server, as a tool that uses it sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Used {
    /// The server.
    #[serde(with = "id")]
    pub server: u64,
    /// How it evaluates: stepwise, batched, offloaded.
    pub mode: String,
    /// Measured, in evaluations a second; none before the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Failures in a row.
    #[serde(with = "id")]
    pub failures: u64,
    /// Why it failed last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Seconds until it gets work again, after a failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub benched: Option<f64>,
}

/// There is work and no server for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NoServer {
    /// Seconds for which there has been no server.
    pub seconds: f64,
    /// What was found instead, for people.
    pub found: String,
}

/// An optimization tool's status.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    #[serde(deserialize_with = "version")]
    version: u64,
    /// The tool's name, unique among the tools on the broker, as in its other messages.
    pub tool: String,
    /// What it does.
    pub state: Activity,
    /// Title of the simulation.
    pub simulation: String,
    /// Name of the run, for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// The generation under way, from 0.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_id")]
    pub generation: Option<u64>,
    /// Generations of the whole run.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_id")]
    pub generations: Option<u64>,
    /// Evaluations that have ended.
    #[serde(with = "id")]
    pub done: u64,
    /// Evaluations to be done: those of the generation, or in steady state those of the whole run.
    #[serde(with = "id")]
    pub total: u64,
    /// Work in progress, the most silent first; at most [`MOST_LISTED`].
    pub waiting_for: Vec<Waiting>,
    /// The servers that it uses; at most [`MOST_LISTED`], those that are benched first.
    pub servers: Vec<Used>,
    /// That there is no server.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_server: Option<NoServer>,
}

impl Status {
    /// The status of a tool that has nothing to do yet.
    #[must_use]
    pub fn new(tool: String, simulation: String) -> Self {
        Self {
            version: 1,
            tool,
            state: Activity::Looking,
            simulation,
            run: None,
            generation: None,
            generations: None,
            done: 0,
            total: 0,
            waiting_for: Vec::new(),
            servers: Vec::new(),
            no_server: None,
        }
    }

    /// Reads a payload.
    ///
    /// # Errors
    /// No JSON object of version 1, a required key missing, a value of the wrong type, a negative duration or speed, too large.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        if payload.len() > MAX_PAYLOAD {
            return Err(DecodeError::TooLarge {
                bytes: payload.len(),
                most: MAX_PAYLOAD,
            });
        }
        // By way of a tree, in which the last of repeated keys wins.
        let object: Map<String, Value> = serde_json::from_slice(payload)?;
        let status: Self = place::read(Value::Object(object), "")?;
        match status.negative() {
            Some((path, number)) => Err(DecodeError::value(format!(
                "\"{path}\" is {number}, expected 0 or more"
            ))),
            None => Ok(status),
        }
    }

    /// The first number that must not be negative and is, with its path.
    fn negative(&self) -> Option<(String, f64)> {
        for (index, waiting) in self.waiting_for.iter().enumerate() {
            if waiting.silent < 0.0 {
                return Some((format!("waiting_for[{index}].silent"), waiting.silent));
            }
        }
        for (index, used) in self.servers.iter().enumerate() {
            for (key, number) in [("speed", used.speed), ("benched", used.benched)] {
                if let Some(number) = number.filter(|number| *number < 0.0) {
                    return Some((format!("servers[{index}].{key}"), number));
                }
            }
        }
        let alone = self.no_server.as_ref().map(|alone| alone.seconds);
        let alone = alone.filter(|seconds| *seconds < 0.0)?;
        Some(("no_server.seconds".to_owned(), alone))
    }

    /// The payload. Numbers that are NaN or infinite must not be in it.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        // Texts and numbers cannot fail to serialize.
        serde_json::to_vec(self).unwrap_or_default()
    }
}

fn version<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    match Id::deserialize(deserializer)?.0 {
        1 => Ok(1),
        other => Err(serde::de::Error::custom(format_args!(
            "\"version\" is {other}, expected 1"
        ))),
    }
}

mod id {
    use super::{Deserialize, Deserializer, Id};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
    pub fn serialize<S: serde::Serializer>(number: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(*number)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        Id::deserialize(deserializer).map(|id| id.0)
    }
}

mod optional_id {
    use super::{Deserialize, Deserializer, Id};

    #[expect(clippy::ref_option, reason = "serde's signature")]
    pub fn serialize<S: serde::Serializer>(
        number: &Option<u64>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        match number {
            Some(number) => serializer.serialize_u64(*number),
            None => serializer.serialize_none(),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<u64>, D::Error> {
        Id::deserialize(deserializer).map(|id| Some(id.0))
    }
}
