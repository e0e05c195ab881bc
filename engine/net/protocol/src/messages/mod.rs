//! The messages that open and close a run: discovery, server, parameters, control (D6.1, Schemas 1 to 4).
//!
//! They are rare, so they are read by way of a JSON tree, in which the last of repeated keys wins.

mod codec;
mod modules;

use serde_json::{Map, Value};

use crate::{Actuator, Fitness, Presence, Sensor, Status, ToServer, ToTool};

pub use modules::{ModuleCode, missing_module};

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

/// What a server must be able to do.
#[derive(Debug, Clone, PartialEq)]
pub struct Requirements {
    /// Number of spatial dimensions, to be met exactly.
    pub dimensions: f64,
    /// Number of agents that the server must be able to simulate; none for no demand.
    pub max_agents: Option<f64>,
}

/// Query of available simulation servers.
#[derive(Debug, Clone, PartialEq)]
pub struct Discovery {
    /// Title of the simulation.
    pub simulation: String,
    /// Echoed by the servers that answer.
    pub simulation_hash: String,
    /// What a server must be able to do.
    pub requirements: Requirements,
    /// Extension: who asks, for people to read.
    pub tool: Option<String>,
}

/// What a server can do.
#[derive(Debug, Clone, PartialEq)]
pub struct Capabilities {
    /// Number of spatial dimensions.
    pub dimensions: f64,
    /// Largest number of agents; none for no limit.
    pub max_agents: Option<f64>,
    /// Extension: what a server built with Swarmwright's wrapper says of itself.
    pub swarmwright: Option<Announcement>,
}

/// The extension part of a server's capabilities.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Announcement {
    /// Version of the extension profile.
    pub version: u64,
    /// Ways of evaluating: stepwise, batched, offloaded, ...
    pub modes: Vec<String>,
    /// Kinds of controller that the server evaluates itself, when offloaded; none if it does not say.
    pub controllers: Vec<String>,
    /// Most episodes of a batch, when batched; none if it does not say.
    pub batch: Option<usize>,
    /// Episodes that are computed in about the time of one, when offloaded; none if it does not say.
    pub lanes: Option<usize>,
    /// Behaviours and conditions in Python that the server has, for controllers of kind `python_modules`.
    pub modules: Vec<ModuleCode>,
    /// Distributions from which the server creates genomes itself in offloaded mode; empty if not announced.
    pub distributions: Vec<String>,
    /// Numbers in a sensor message.
    pub sensors: Option<usize>,
    /// Numbers in an actuator message.
    pub actuators: Option<usize>,
    /// Names of what is measured in an episode beside the fitness.
    pub metrics: Vec<String>,
    /// How far two evaluations of one episode agree: bitwise, statistical, none; nothing where the server does not say.
    pub determinism: Option<String>,
    /// With `statistical`: how far fitness and metrics may differ, as a part of the larger one, absolute below 1.
    pub tolerance: Option<f64>,
    /// Whether it sends the scenes of stepwise episodes to tools that ask for them.
    pub scenes: bool,
    /// Whether it hears control messages on its own topic too.
    pub control: bool,
    /// Random for each start of a server: tells two servers with one id apart.
    pub instance: Option<String>,
    /// Host on which the server runs.
    pub host: Option<String>,
    /// Its process id there.
    pub pid: Option<u64>,
}

/// A server's answer to a discovery.
#[derive(Debug, Clone, PartialEq)]
pub struct ServerMessage {
    /// The server's id.
    pub server: u64,
    /// The hash of the discovery that is answered.
    pub simulation_hash: String,
    /// Titles of the simulations that it offers.
    pub simulations: Vec<String>,
    /// What it can do.
    pub capabilities: Capabilities,
}

/// Configuration of one server's simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct ParametersMessage {
    /// The server addressed.
    pub server: u64,
    /// Tells the episode.
    pub simulation_hash: String,
    /// The problem-specific parameters.
    pub parameters: Map<String, Value>,
}

/// What of scenes is sent only to tools that name it.
pub const SCENE_PARTS: [&str; 2] = ["rays", "links"];

/// Start or end of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Control {
    /// The server addressed.
    pub server: u64,
    /// Title of the simulation; the published schema requires it, its examples leave it out.
    pub simulation: Option<String>,
    /// Tells the episode.
    pub simulation_hash: String,
    /// Start (true, the default) or end.
    pub run: bool,
    /// Whether the server is to show the run.
    pub visual: bool,
    /// Extension: who asks, for people to read; keeps the server reserved between two episodes.
    pub tool: Option<String>,
    /// Extension: topic, without prefix, on which the server says that the episode failed.
    pub reply: Option<String>,
    /// Extension: which start of the server is meant, as it announced it; another one with its id is not.
    pub instance: Option<String>,
    /// Extension: the scene of every step is wanted on the topic of `reply`, and of what not all tools draw, these parts:
    /// [`SCENE_PARTS`].
    pub scenes: Option<Vec<String>>,
}
