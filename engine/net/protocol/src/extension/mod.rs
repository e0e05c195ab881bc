//! Extension messages with blocks of numbers: offloaded and batched evaluation (docs/reference/protocol.md).
//!
//! They are MessagePack maps with text keys; arrays of numbers are binary, little-endian, without a header. Unknown
//! keys are ignored. Shapes are checked during decoding, so users of a message need not check them.

mod codec;
mod numbers;
pub(crate) mod reader;
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
/// Media type of all extension messages, sent as the content type of MQTT 5.
pub const MEDIA_TYPE: &str = "application/msgpack";
/// Largest extension payload in bytes; larger ones are refused unread.
pub const MAX_BLOCK: usize = 64 << 20;

/// Request for an offloaded evaluation of all candidates in all episodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluate {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// Number chosen by the tool and echoed in the result.
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
    /// Names of the metrics that the answer must contain besides the fitness.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// Number of the attempt at this work, from 1.
    pub attempt: u32,
    /// Seconds after which the tool gives the work to another server.
    pub lease: f64,
    /// The instance that the server announced; another instance with its id must refuse the request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
    /// Sample from which the server generates the genomes, if it announces the distribution.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample: Option<Box<Sample>>,
}

/// Name of the distribution from which every server with [`Sample`] generates genomes.
pub const NORMAL: &str = "normal";

/// Consecutive candidates of a generation (protocol/schemas/sample.schema.json).
///
/// Each row has one number per gene, that is, per weight of the controller.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// [`NORMAL`].
    pub distribution: String,
    /// Seed of the run.
    pub seed: u64,
    /// Purpose of the random numbers.
    pub purpose: String,
    /// Index of the generation.
    pub generation: u64,
    /// Index of the first candidate.
    pub first: u64,
    /// Number of candidates.
    pub count: u64,
    /// Whether candidates 2 i and 2 i + 1 lie on opposite sides of the center.
    pub mirrored: bool,
    /// Mean of the candidates.
    pub center: F64s,
    /// Standard deviation of each gene.
    pub deviation: F64s,
    /// Value of each gene at the coordinate 0.
    pub middle: F64s,
    /// Change of each gene per unit of the coordinate.
    pub reach: F64s,
    /// Smallest value of each gene, within the range of binary32.
    pub lower: F64s,
    /// Largest value of each gene, within the range of binary32.
    pub upper: F64s,
}

impl Sample {
    /// Returns the rows of one number per gene, with their names.
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

    /// Returns whether the genomes would fit into a message.
    #[must_use]
    pub fn fits(&self) -> bool {
        let genomes = (self.center.0.len() as u64).saturating_mul(self.count);
        genomes.saturating_mul(size_of::<f32>() as u64) <= MAX_BLOCK as u64
    }

    /// Returns what is wrong with the sample, regardless of the controller; `None` if it is valid.
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
    /// Number of the request.
    pub request: u64,
    /// Id of the server.
    pub server: u64,
    /// (candidates, episodes), row-major; NaN for the episodes in `failed`. Empty if there is an `error`.
    #[serde(default)]
    pub fitness: F64s,
    /// Requested metrics, each with the shape of `fitness`.
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
    /// What went wrong, for users.
    pub reason: String,
    /// Place in the simulation's code, in the format of its language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stack: Option<String>,
}

/// Why a request was not served.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// Kind of refusal, for programs.
    pub kind: RefusalKind,
    /// Reason, for users.
    pub reason: String,
}

/// Kinds of refusals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefusalKind {
    /// Another tool has the server; try another server, or later.
    Taken,
    /// This server cannot serve the request, because of its simulation, controller kind or a parameter.
    Invalid,
    /// The simulation failed as a whole.
    Failed,
}

/// Tool to server: a batch of episodes to be stepped together; one message per step holds all agents.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchStart {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// Number chosen by the tool and echoed in every message of the batch.
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
    /// Names of the metrics that must be sent with the fitness of each episode.
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
    /// Number of the batch.
    pub request: u64,
    /// Step of the sensors that are answered.
    pub step: u64,
    /// (rows of the sensors, actuators), row-major; empty to end the batch.
    pub actuators: F32s,
}

/// Messages from tool to server, on one topic.
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

/// Server to tool: sensors of all agents that act next, in all episodes, and the episodes that have ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchSensors {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// Number of the batch.
    pub request: u64,
    /// Id of the server.
    pub server: u64,
    /// Number of the message in the batch, from 0.
    pub step: u64,
    /// Index of the episode of each row.
    pub episodes: U32s,
    /// Index of the agent of each row.
    pub agents: U32s,
    /// (rows, sensors), row-major.
    pub sensors: F32s,
    /// Episodes that ended in the previous step.
    pub ended: U32s,
    /// Fitness of the ended episodes.
    pub fitness: F64s,
    /// Requested metrics of the ended episodes, each with the shape of `ended`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, F64s>,
    /// Episodes that failed in the previous step; `candidate` is 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<Failure>,
    /// Why the batch is not served.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Refusal>,
}

/// Server to tool: a stepwise episode has ended without fitness. Sent only to tools that name a reply topic in their
/// control message; other tools wait for the fitness in vain.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failed {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// Id of the server.
    pub server: u64,
    /// Hash of the control message that started the episode.
    pub simulation_hash: String,
    /// What went wrong, for users.
    pub reason: String,
    /// Place in the simulation's code, in the format of its language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stack: Option<String>,
    /// Whether the simulation refuses the parameters, so that a retry on this server would fail, too.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub invalid: bool,
}

/// Messages from server to tool, on one topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ToTool {
    /// Result of an offloaded evaluation.
    Evaluated(Evaluated),
    /// A step of a batch.
    Sensors(BatchSensors),
    /// A stepwise episode has failed.
    Failed(Failed),
    /// The scene of a stepwise episode.
    Scene(Box<SceneMessage>),
}

/// Largest number of characters of a failure's reason; writers shorten longer ones, and so do readers that store them.
pub const MOST_REASON: usize = 2_000;
/// Largest number of characters of a failure's stack, like [`MOST_REASON`].
pub const MOST_STACK: usize = 8_000;

/// Shortens a text to at most `most` characters, and marks the cut.
#[must_use]
pub fn shortened(mut text: String, most: usize) -> String {
    // Fast path: a text has at most as many characters as bytes.
    if text.len() > most
        && let Some((end, _)) = text.char_indices().nth(most)
    {
        let cut = text.char_indices().nth(most.saturating_sub(3));
        text.truncate(cut.map_or(end, |(index, _)| index));
        text.push_str("...");
    }
    text
}

/// Header of a request, decoded if the request as a whole is invalid, so that it can be refused with a reason.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Envelope {
    /// Kind of the message, such as `evaluate` or `start`.
    pub kind: String,
    /// Number of the request.
    pub request: u64,
    /// Topic for the answer, without prefix.
    pub reply: String,
}
