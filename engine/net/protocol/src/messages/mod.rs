//! Messages that start and end a run: discovery, server, parameters, control (D6.1, Schemas 1 to 4).
//!
//! They are rare, so they are decoded via a JSON tree; the last of repeated keys wins.

mod codec;
mod modules;
mod sides;

use serde_json::{Map, Value};

use crate::{Actuator, Fitness, Presence, Sensor, Status, ToServer, ToTool};

pub use modules::{ModuleCode, missing_module};
pub use sides::AnnouncedSide;

/// Any message, by topic.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "each variant is the message of that name")]
pub enum Message {
    Discovery(Discovery),
    Server(ServerMessage),
    Parameters(ParametersMessage),
    Control(Control),
    Sensor(Sensor),
    Actuator(Actuator),
    Fitness(Fitness),
    Presence(Presence),
    ToServer(ToServer),
    ToTool(ToTool),
    Status(Box<Status>),
}

/// Requirements for a server.
#[derive(Debug, Clone, PartialEq)]
pub struct Requirements {
    /// Number of spatial dimensions, which must match exactly.
    pub dimensions: f64,
    /// Number of agents that the server must be able to simulate; `None` for any.
    pub max_agents: Option<f64>,
}

/// Query of available simulation servers.
#[derive(Debug, Clone, PartialEq)]
pub struct Discovery {
    /// Title of the simulation.
    pub simulation: String,
    /// Hash that the servers echo in their answers.
    pub simulation_hash: String,
    /// Requirements for a server.
    pub requirements: Requirements,
    /// Extension: name of the tool that asks, for users.
    pub tool: Option<String>,
}

/// Capabilities of a server.
#[derive(Debug, Clone, PartialEq)]
pub struct Capabilities {
    /// Number of spatial dimensions.
    pub dimensions: f64,
    /// Largest number of agents; `None` for no limit.
    pub max_agents: Option<f64>,
    /// Extension: announcement of a server built with Swarmwright's wrapper.
    pub swarmwright: Option<Announcement>,
}

/// The extension part of a server's capabilities.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Announcement {
    /// Version of the extension profile.
    pub version: u64,
    /// Modes of evaluation: stepwise, batched, offloaded, ...
    pub modes: Vec<String>,
    /// Kinds of controllers that the server evaluates in offloaded mode; empty if not announced.
    pub controllers: Vec<String>,
    /// Largest number of episodes of a batch; `None` if not announced.
    pub batch: Option<usize>,
    /// Number of episodes that are computed in about the time of one in offloaded mode; `None` if not announced.
    pub lanes: Option<usize>,
    /// Python behaviours and conditions that the server has, for controllers of kind `python_modules`.
    pub modules: Vec<ModuleCode>,
    /// Distributions from which the server generates genomes itself in offloaded mode; empty if not announced.
    pub distributions: Vec<String>,
    /// Length of a sensor message.
    pub sensors: Option<usize>,
    /// Length of an actuator message.
    pub actuators: Option<usize>,
    /// Names of the metrics of an episode besides the fitness.
    pub metrics: Vec<String>,
    /// Sides of a match; empty if not announced.
    pub sides: Vec<AnnouncedSide>,
    /// Agreement between two evaluations of one episode: bitwise, statistical or none; `None` if not announced.
    pub determinism: Option<String>,
    /// With `statistical`: largest difference of fitness and metrics, relative to the larger value, or absolute if that
    /// is below 1.
    pub tolerance: Option<f64>,
    /// Whether the server sends the scenes of stepwise episodes to tools that request them.
    pub scenes: bool,
    /// Whether the server also receives control messages on its own topic.
    pub control: bool,
    /// Random text for each start of a server, which distinguishes two servers with the same id.
    pub instance: Option<String>,
    /// Host on which the server runs.
    pub host: Option<String>,
    /// Process id on that host.
    pub pid: Option<u64>,
}

/// A server's answer to a discovery.
#[derive(Debug, Clone, PartialEq)]
pub struct ServerMessage {
    /// Id of the server.
    pub server: u64,
    /// Hash of the discovery that is answered.
    pub simulation_hash: String,
    /// Titles of the offered simulations.
    pub simulations: Vec<String>,
    /// Capabilities of the server.
    pub capabilities: Capabilities,
}

/// Configuration of one server's simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct ParametersMessage {
    /// Id of the addressed server.
    pub server: u64,
    /// Hash that identifies the episode.
    pub simulation_hash: String,
    /// The problem-specific parameters.
    pub parameters: Map<String, Value>,
}

/// Parts of a scene that are sent only to tools that request them.
pub const SCENE_PARTS: [&str; 2] = ["rays", "links"];

/// Start or end of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Control {
    /// Id of the addressed server.
    pub server: u64,
    /// Title of the simulation; required by the published schema, but omitted in its examples.
    pub simulation: Option<String>,
    /// Hash that identifies the episode.
    pub simulation_hash: String,
    /// Whether to start (the default) or to end the run.
    pub run: bool,
    /// Whether the server should display the run.
    pub visual: bool,
    /// Extension: name of the tool, for users; the server stays reserved for it between two episodes.
    pub tool: Option<String>,
    /// Extension: topic, without prefix, on which the server reports failures of the episode.
    pub reply: Option<String>,
    /// Extension: the announced instance of the server that is meant; another one with its id ignores the message.
    pub instance: Option<String>,
    /// Extension: requests the scene of every step on the topic `reply`, with these optional parts out of
    /// [`SCENE_PARTS`].
    pub scenes: Option<Vec<String>>,
}
