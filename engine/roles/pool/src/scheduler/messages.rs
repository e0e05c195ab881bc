//! Messages of this tool, and the hashes that identify its episodes and discoveries.

use serde_json::{Map, Value};
use swarmwright_controllers::Controller;
use swarmwright_protocol::{
    Control, Discovery, EXTENSION_VERSION, EpisodeHasher, Evaluate, F32s, Topics, U64s,
};

use crate::config::Config;
use crate::work::Work;

/// Data for messages besides the configuration.
pub(crate) struct Messages {
    /// Topic on which requests are answered, without prefix.
    reply: String,
    agents: Option<u64>,
    discovery: EpisodeHasher,
    /// Number for the next hash; each hash uses a new number.
    instance: u64,
    /// Parameters and hasher for each episode seed.
    episodes: Vec<(Map<String, Value>, EpisodeHasher)>,
}

/// Returns the number of agents, if the parameters determine it.
fn agents(parameters: &Map<String, Value>) -> Option<u64> {
    // The defenders of Minisim are then agents, too.
    if parameters.get("defenderSteering").and_then(Value::as_str) == Some("controller") {
        return None;
    }
    #[expect(
        clippy::cast_precision_loss,
        reason = "a list is far shorter than 2^53"
    )]
    let listed = || Some(parameters.get("agents")?.as_array()?.len() as f64);
    let agents = parameters
        .get("numAgents")
        .and_then(Value::as_f64)
        .or_else(listed)
        .filter(|agents| (1.0..1e9).contains(agents))?;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "checked to be a number of agents"
    )]
    Some(agents as u64)
}

impl Messages {
    pub fn new(config: &Config) -> Self {
        Self {
            reply: Topics::default().to_tool(&config.token),
            agents: agents(&config.parameters),
            discovery: EpisodeHasher::new(&config.demand.simulation, &config.parameters),
            instance: config.first_instance,
            episodes: Vec::new(),
        }
    }

    /// Prepares for new work with these seeds.
    pub fn begin(&mut self, config: &Config, seeds: &[u64]) {
        self.episodes = seeds
            .iter()
            .map(|&seed| {
                let mut parameters = config.parameters.clone();
                parameters.insert("seed".to_owned(), seed.into());
                let hasher = EpisodeHasher::new(&config.demand.simulation, &parameters);
                (parameters, hasher)
            })
            .collect();
    }

    /// Returns the number of agents, if the parameters determine it.
    pub fn agents(&self) -> Option<u64> {
        self.agents
    }

    /// Returns the topic on which requests are answered, without prefix.
    pub fn reply(&self) -> &str {
        &self.reply
    }

    pub fn new_hash(&mut self) -> String {
        let hash = self.discovery.hash(self.instance);
        self.instance += 1;
        hash
    }

    /// Returns parameters and a new hash for an attempt at an episode.
    pub fn episode(
        &mut self,
        config: &Config,
        prototype: &Controller,
        episode: usize,
    ) -> (Map<String, Value>, String) {
        let (parameters, hasher) = &self.episodes[episode];
        let parameters = prototype.merged(parameters).into_owned();
        let hash = if prototype.steers() {
            hasher.hash(self.instance)
        } else {
            EpisodeHasher::new(&config.demand.simulation, &parameters).hash(self.instance)
        };
        self.instance += 1;
        (parameters, hash)
    }

    /// Returns a request for a block of the work without genomes and seeds; its other fields have their largest size.
    pub fn block(&self, config: &Config, work: &Work) -> Evaluate {
        Evaluate {
            version: EXTENSION_VERSION,
            request: u64::MAX,
            tool: config.tool.clone(),
            reply: self.reply.clone(),
            simulation: config.demand.simulation.clone(),
            parameters: config.parameters.clone(),
            controller: work.specification().clone(),
            genomes: F32s::default(),
            seeds: U64s::default(),
            metrics: config.demand.metrics.clone(),
            attempt: u32::MAX,
            lease: 0.5,
            instance: None,
            sample: None,
        }
    }

    pub fn discovery(&self, config: &Config, hash: String) -> Discovery {
        Discovery {
            simulation: config.demand.simulation.clone(),
            simulation_hash: hash,
            requirements: config.demand.requirements.clone(),
            tool: Some(config.tool.clone()),
        }
    }

    /// Builds a control message. `instance`: the instance of the server, given if the server is to run and announces
    /// it.
    pub fn control(
        &self,
        config: &Config,
        server: u64,
        instance: Option<String>,
        hash: String,
        run: bool,
    ) -> Control {
        Control {
            server,
            instance,
            simulation: Some(config.demand.simulation.clone()),
            simulation_hash: hash,
            run,
            visual: run && config.visual,
            tool: Some(config.tool.clone()),
            reply: run.then(|| self.reply.clone()),
            scenes: None,
        }
    }
}
