//! Extension messages that carry blocks of numbers: offloaded evaluation and batched stepwise (docs/reference/protocol.md).
//!
//! They are MessagePack maps with text keys; arrays of numbers are binary, little-endian, without a header. Unknown keys
//! are ignored. Shapes are checked where a message is read, so that code that has one need not.

mod codec;
mod numbers;
mod scene;

pub use numbers::{F32s, F64s, U32s, U64s};
pub use scene::{
    Bodies, NO_AGENT, Rays, SceneLight, SceneMessage, ScenePatch, SceneScale, SceneStyle, SceneWall,
};

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::values::bounded;

/// Version of all extension messages.
pub const EXTENSION_VERSION: u64 = 1;
/// Media type of all extension messages: the content type of MQTT 5.
pub const MEDIA_TYPE: &str = "application/msgpack";
/// Larger extension payloads are refused unread.
pub const MAX_BLOCK: usize = 64 << 20;

/// Request for offloaded evaluation: every candidate in every episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluate {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// Chosen by the tool, echoed in the result.
    pub request: u64,
    /// Name of the tool, unique on the broker.
    pub tool: String,
    /// Topic for the result, without prefix.
    pub reply: String,
    /// Title of the simulation.
    pub simulation: String,
    /// Parameters; `seed` in them is replaced by each of `seeds`.
    #[serde(deserialize_with = "bounded")]
    pub parameters: Map<String, Value>,
    /// Controller specification without its weights (protocol/schemas/controller.schema.json).
    #[serde(deserialize_with = "bounded")]
    pub controller: Map<String, Value>,
    /// (candidates, weights), row-major; empty if the server creates them itself, see `sample`.
    pub genomes: F32s,
    /// One seed per episode, at least one.
    pub seeds: U64s,
    /// Names of the metrics that the answer is to have beside the fitness.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// 1 for the first try of this work.
    pub attempt: u32,
    /// Seconds after which the tool gives the work to another server.
    pub lease: f64,
    /// The instance that the server announced; another instance with its id must refuse the request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
    /// In place of genomes: what the server makes them from, if it announces the distribution.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample: Option<Box<Sample>>,
}

/// The distribution that every server with [`Sample`] makes genomes from.
pub const NORMAL: &str = "normal";

/// Candidates of a generation by their numbers (protocol/schemas/sample.schema.json).
///
/// Of numbers for each gene there are as many as a controller has weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// [`NORMAL`].
    pub distribution: String,
    /// Of the run.
    pub seed: u64,
    /// What the random numbers are for.
    pub purpose: String,
    /// The generation.
    pub generation: u64,
    /// Number of the first candidate.
    pub first: u64,
    /// Number of candidates.
    pub count: u64,
    /// Whether candidates 2 i and 2 i + 1 lie on opposite sides of the center.
    pub mirrored: bool,
    /// Point that the candidates are around.
    pub center: F64s,
    /// Standard deviation for each gene.
    pub deviation: F64s,
    /// Value of each gene where a point is 0.
    pub middle: F64s,
    /// Change of each gene if a point changes by 1.
    pub reach: F64s,
    /// Least value of each gene, within the range of binary32.
    pub lower: F64s,
    /// Largest value of each gene, within the range of binary32.
    pub upper: F64s,
}

impl Sample {
    /// The rows of numbers for each gene, by name.
    #[must_use]
    pub fn rows(&self) -> [(&'static str, &[f64]); 6] {
        [
            ("center", &self.center.0),
            ("deviation", &self.deviation.0),
            ("middle", &self.middle.0),
            ("reach", &self.reach.0),
            ("lower", &self.lower.0),
            ("upper", &self.upper.0),
        ]
    }

    /// Whether its genomes would fit into a message.
    #[must_use]
    pub fn fits(&self) -> bool {
        let genomes = (self.center.0.len() as u64).saturating_mul(self.count);
        genomes.saturating_mul(size_of::<f32>() as u64) <= MAX_BLOCK as u64
    }

    /// What is wrong with it, whatever the controller; none if nothing is.
    #[must_use]
    pub fn problem(&self) -> Option<String> {
        let genes = self.center.0.len();
        for (name, row) in self.rows() {
            if row.len() != genes {
                let count = row.len();
                return Some(format!(
                    "\"sample.{name}\" has {count} numbers, \"sample.center\" {genes}"
                ));
            }
            let most = match name {
                "lower" | "upper" => f64::from(f32::MAX),
                _ => f64::MAX,
            };
            if let Some(index) = row
                .iter()
                .position(|number| number.is_nan() || number.abs() > most)
            {
                return Some(format!(
                    "\"sample.{name}\"[{index}] is {}, expected a number of at most {most:e} in size",
                    row[index]
                ));
            }
        }
        if self.first.checked_add(self.count).is_none() {
            return Some("\"sample.first\" is too large".to_owned());
        }
        None
    }
}

/// Reply to [`Evaluate`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluated {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// The request's number.
    pub request: u64,
    /// The server's id.
    pub server: u64,
    /// (candidates, episodes), row-major; NaN where `failed` says why. Empty when `error` is there.
    #[serde(default)]
    pub fitness: F64s,
    /// The metrics that were asked for, each of the shape of `fitness`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, F64s>,
    /// Episodes that failed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<Failure>,
    /// Why nothing was evaluated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Refusal>,
    /// Seconds of computation.
    pub seconds: f64,
}

/// One episode that failed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Index of the candidate in the request.
    pub candidate: u64,
    /// Index of the seed in the request.
    pub episode: u64,
    /// What went wrong, for people.
    pub reason: String,
    /// Where in the simulation's code, in the words of its language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stack: Option<String>,
}

/// Why a request was not served.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// For programs.
    pub kind: RefusalKind,
    /// For people.
    pub reason: String,
}

/// Why a request was not served, for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefusalKind {
    /// Another tool has the server: try another server, or later.
    Taken,
    /// The request cannot be served by this server: another simulation, controller kind, parameter.
    Invalid,
    /// The simulation failed as a whole.
    Failed,
}

/// Tool to server: a batch of episodes to be stepped together, all agents in one message a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchStart {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// Chosen by the tool, echoed in every message of the batch.
    pub request: u64,
    /// Name of the tool, unique on the broker.
    pub tool: String,
    /// Topic for the server's messages, without prefix.
    pub reply: String,
    /// Title of the simulation.
    pub simulation: String,
    /// Parameters; `seed` in them is replaced by each of `seeds`.
    #[serde(deserialize_with = "bounded")]
    pub parameters: Map<String, Value>,
    /// One seed per episode of the batch.
    pub seeds: U64s,
    /// Names of the metrics that are to come with the fitness of each episode.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// The instance that the server announced; another instance with its id must refuse the request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
}

/// Tool to server: the actuators for the last [`BatchSensors`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchActuators {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// The batch.
    pub request: u64,
    /// The step of the sensors that are answered.
    pub step: u64,
    /// (rows of the sensors, actuators), row-major; none to end the batch.
    pub actuators: F32s,
}

/// Tool to server, on one topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ToServer {
    /// Offloaded evaluation.
    Evaluate(Evaluate),
    /// Start of a batch.
    Start(BatchStart),
    /// A step of a batch.
    Actuators(BatchActuators),
}

/// Server to tool: sensors of all agents that act next, of all episodes, and the episodes that have ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchSensors {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// The batch.
    pub request: u64,
    /// The server's id.
    pub server: u64,
    /// Counts the messages of a batch from 0.
    pub step: u64,
    /// Index of the episode of each row.
    pub episodes: U32s,
    /// Index of the agent of each row.
    pub agents: U32s,
    /// (rows, sensors), row-major.
    pub sensors: F32s,
    /// Episodes that ended with the step before.
    pub ended: U32s,
    /// Their fitness.
    pub fitness: F64s,
    /// Their metrics that were asked for, each of the shape of `ended`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, F64s>,
    /// Episodes that failed in the previous step; `candidate` is 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<Failure>,
    /// Why the batch is not served.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Refusal>,
}

/// Server to tool: a stepwise episode has ended without fitness. Sent to tools that name a topic for it in their control
/// message; all others miss the fitness.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failed {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// The server's id.
    pub server: u64,
    /// Of the control message that started the episode.
    pub simulation_hash: String,
    /// What went wrong, for people.
    pub reason: String,
    /// Where in the simulation's code, in the words of its language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stack: Option<String>,
    /// Whether the simulation refuses the parameters, so that no other attempt will go better on this server.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub invalid: bool,
}

/// Server to tool, on one topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ToTool {
    /// Result of an offloaded evaluation.
    Evaluated(Evaluated),
    /// A step of a batch.
    Sensors(BatchSensors),
    /// A stepwise episode has failed.
    Failed(Failed),
    /// What a stepwise episode looks like at a step.
    Scene(Box<SceneMessage>),
}

/// Characters of a failure's reason and stack, at most: writers cut longer ones, and so do readers that keep them.
pub const MOST_REASON: usize = 2_000;
/// See [`MOST_REASON`].
pub const MOST_STACK: usize = 8_000;

/// A text of at most `most` characters; a cut is marked.
#[must_use]
pub fn shortened(mut text: String, most: usize) -> String {
    // Texts are short as a rule, which their bytes tell.
    if text.len() > most
        && let Some((end, _)) = text.char_indices().nth(most)
    {
        let cut = text.char_indices().nth(most.saturating_sub(3));
        text.truncate(cut.map_or(end, |(index, _)| index));
        text.push_str("...");
    }
    text
}

/// The header of a request, read if the whole is invalid, so that it can be refused with a reason.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Envelope {
    /// evaluate, start, ...
    pub kind: String,
    /// The request's number.
    pub request: u64,
    /// Topic for the answer, without prefix.
    pub reply: String,
}
