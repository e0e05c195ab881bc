//! An episode on a server that publishes scenes, with the controllers in this process (docs/reference/protocol.md,
//! Scenes).

mod discovery;
mod reading;

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use serde_json::{Map, Value};
use swarmwright_controllers::{Controller, SwarmControllers};
use swarmwright_mqtt::{
    ConnectError, Connection, Event, PublishOptions, QoS, Settings, Subscription, TooLarge,
};
use swarmwright_protocol::{
    Control, EpisodeHasher, Fitness, ParametersMessage, ReadingWriter, Requirements, SCENE_PARTS,
    SceneMessage, Topic, TopicError, Topics,
};

/// How long the chosen server may take to begin; the step time-out applies if it is shorter.
const BEGIN: Duration = Duration::from_secs(10);
/// Interval between calls of the caller's callback.
const TURN: Duration = Duration::from_millis(100);
/// Time to wait for scenes that the fitness has overtaken.
const OVERTAKEN: Duration = Duration::from_millis(250);
/// How long a step with messages but without a scene may take, in multiples of the step time-out.
const MOST_STEPS: u32 = 10;

/// Episode and time limits.
#[derive(Debug, Clone)]
pub struct SceneOptions {
    /// Connection settings of the broker.
    pub settings: Settings,
    /// Topic prefix, empty for none.
    pub prefix: String,
    /// Title of the simulation.
    pub simulation: String,
    /// Requirements for servers.
    pub requirements: Requirements,
    /// Parameters of the episode, including its seed.
    pub parameters: Map<String, Value>,
    /// Controller of every agent.
    pub controller: Controller,
    /// How long to wait for a server with scenes.
    pub discovery: Duration,
    /// How long to wait for the next message of an episode.
    pub step: Duration,
}

/// The error type of a [`SceneEpisode`].
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The connection to the broker could not be established.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The prefix cannot be used in a topic.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// A retry would fail the same way.
    #[error("{0}")]
    Impossible(String),
    /// Messages or the server were lost; a retry may succeed.
    #[error("{0}")]
    Lost(String),
    /// The caller requested a stop.
    #[error("interrupted")]
    Interrupted,
}

use SceneError::{Impossible, Interrupted, Lost};

/// A message of the episode.
enum News {
    Sensors { agent: usize, values: Vec<f32> },
    Scene(Box<SceneMessage>),
}

/// Last sensors and actuators of an agent.
#[derive(Default)]
struct Acted {
    sensors: Vec<f32>,
    actuators: Vec<f32>,
    /// Step of the last action.
    step: Option<u64>,
}

/// An episode that a server computes step by step.
pub struct SceneEpisode {
    connection: Connection,
    topics: Topics,
    options: SceneOptions,
    reply: String,
    tool: String,
    server: u64,
    /// Whether the server receives control messages on its own topic.
    on_own_topic: bool,
    hash: String,
    writer: ReadingWriter,
    events: Vec<Event>,
    /// Messages that have arrived but are not processed.
    waiting: VecDeque<News>,
    agents: Vec<Acted>,
    controllers: SwarmControllers,
    scene: SceneMessage,
    /// Number of missing scenes.
    missing: u64,
    /// Fitness and the time of its arrival; it may have overtaken scenes.
    fitness: Option<(Fitness, Instant)>,
    /// Final fitness and metrics.
    ended: Option<(f64, BTreeMap<String, f64>)>,
    heard: Instant,
}

/// A server that has scenes.
struct SceneServer {
    server: u64,
    /// Instance of the server that answered.
    instance: Option<String>,
    /// Whether it receives control messages on its own topic.
    on_own_topic: bool,
}

/// Callback for each action of an agent: its index, sensors and actuators.
pub type Observe<'a> = &'a mut dyn FnMut(u32, &[f32], &[f32]);
/// Callback that returns whether to continue; called every 0.1 s.
pub type GoOn<'a> = &'a mut dyn FnMut() -> bool;

impl SceneEpisode {
    /// Finds a server and waits for the scene before the first step.
    ///
    /// # Errors
    /// See [`SceneError`].
    pub fn start(options: SceneOptions, go_on: GoOn<'_>) -> Result<Self, SceneError> {
        let topics = Topics::new(&options.prefix)?;
        let token = format!("{:016x}", fastrand::u64(..));
        let at = |filter| Subscription {
            filter,
            qos: QoS::AtMostOnce,
        };
        let subscriptions = vec![
            at(topics.name(Topic::Server)),
            at(topics.name(Topic::Sensor)),
            at(topics.name(Topic::Fitness)),
            at(topics.to_tool(&token)),
        ];
        let connection = Connection::open(options.settings.clone(), subscriptions)?;
        let host = gethostname::gethostname().to_string_lossy().into_owned();
        let parameters = options.controller.merged(&options.parameters).into_owned();
        let hasher = EpisodeHasher::new(&options.simulation, &parameters);
        let first = fastrand::u64(..1 << 52);
        let hash = hasher.hash(first + 1);
        let mut episode = Self {
            writer: ReadingWriter::actuator(&options.simulation, &hash),
            reply: Topics::default().to_tool(&token),
            tool: format!(
                "replay@{host}/{}/{:04x}",
                std::process::id(),
                fastrand::u16(..)
            ),
            connection,
            topics,
            server: 0,
            on_own_topic: false,
            hash,
            events: Vec::new(),
            waiting: VecDeque::new(),
            agents: Vec::new(),
            controllers: SwarmControllers::new(options.controller.clone()),
            scene: SceneMessage::default(),
            missing: 0,
            fitness: None,
            ended: None,
            heard: Instant::now(),
            options,
        };
        let SceneServer {
            server,
            instance,
            on_own_topic,
        } = episode.find(&hasher.hash(first), go_on)?;
        (episode.server, episode.on_own_topic) = (server, on_own_topic);
        let message = ParametersMessage {
            server,
            simulation_hash: episode.hash.clone(),
            parameters,
        };
        episode.send(Topic::Parameters, &message.encode())?;
        episode.control(true, instance)?;
        let begun = episode.begin(go_on);
        if begun.is_err() {
            episode.give_up();
        }
        begun.map(|()| episode)
    }

    fn broken(&self, reason: &str) -> SceneError {
        Lost(format!(
            "the connection to {} broke: {reason}",
            self.connection.url()
        ))
    }

    /// Waits for messages until `until`, but at most for 0.1 s.
    fn turn(&mut self, until: Instant, go_on: GoOn<'_>) -> Result<(), SceneError> {
        let until = until.min(Instant::now() + TURN);
        self.connection.poll(until, &mut self.events);
        if go_on() { Ok(()) } else { Err(Interrupted) }
    }

    fn send(&mut self, topic: Topic, payload: &[u8]) -> Result<(), SceneError> {
        let name = if topic == Topic::Control && self.on_own_topic {
            self.topics.to_server(self.server)
        } else {
            self.topics.name(topic)
        };
        let options = PublishOptions {
            // A server would take a second copy for the next step.
            confirm: topic != Topic::Actuator,
            ..PublishOptions::default()
        };
        let sent = self.connection.publish_with(&name, payload, &options);
        sent.map_err(|TooLarge { bytes, most }| {
            Impossible(format!(
                "a {} message of {bytes} bytes is larger than the {most} that the broker accepts",
                topic.name()
            ))
        })
    }

    fn control(&mut self, run: bool, instance: Option<String>) -> Result<(), SceneError> {
        let parts = || SCENE_PARTS.iter().map(ToString::to_string).collect();
        let control = Control {
            server: self.server,
            simulation: Some(self.options.simulation.clone()),
            simulation_hash: self.hash.clone(),
            run,
            visual: false,
            tool: Some(self.tool.clone()),
            reply: run.then(|| self.reply.clone()),
            instance,
            scenes: run.then(parts),
        };
        self.send(Topic::Control, &control.encode())
    }

    /// Waits for the first scene.
    fn begin(&mut self, go_on: GoOn<'_>) -> Result<(), SceneError> {
        self.heard = Instant::now();
        let limit = self.heard + self.options.step.min(BEGIN);
        loop {
            // Sensor messages may overtake the scene.
            let first = |news: &News| matches!(news, News::Scene(_));
            if let Some(index) = self.waiting.iter().position(first)
                && let Some(News::Scene(scene)) = self.waiting.remove(index)
            {
                self.missing = scene.step;
                self.scene = *scene;
                return self.look_ahead(go_on);
            }
            let begun = self.fitness.is_some() || !self.waiting.is_empty();
            if self.settled() || Instant::now() >= limit {
                let why = if begun {
                    "announces scenes, but sent none"
                } else {
                    "did not begin the episode; another tool may have it"
                };
                return Err(Lost(format!("server {} {why}", self.server)));
            }
            self.receive(limit, go_on)?;
        }
    }

    /// Waits until it is known whether the episode continues after the scene. An episode without controllers is
    /// received completely, since its server does not wait and a broker buffers little.
    fn look_ahead(&mut self, go_on: GoOn<'_>) -> Result<(), SceneError> {
        let steers = self.options.controller.steers();
        let step = self.scene.step;
        let goes_on = |news: &News| match news {
            News::Sensors { .. } => true,
            News::Scene(scene) => scene.step > step,
        };
        while !self.settled() {
            if steers && self.waiting.iter().any(goes_on) {
                return Ok(());
            }
            self.wait(go_on)?;
        }
        if !self.waiting.iter().any(goes_on) {
            self.end();
        }
        Ok(())
    }

    /// Returns whether the fitness has arrived, and all messages that it may have overtaken.
    fn settled(&self) -> bool {
        let came = self.fitness.as_ref().map(|(_, came)| *came);
        came.is_some_and(|came| came.elapsed() >= OVERTAKEN)
    }

    fn end(&mut self) {
        if let Some((fitness, _)) = self.fitness.take() {
            self.ended = Some((fitness.fitness, fitness.metrics));
            self.waiting.clear();
            self.free();
        }
    }

    /// Advances by one step: agents act until the next scene arrives. Does nothing once the episode has ended.
    ///
    /// # Errors
    /// See [`SceneError`]; the episode is then given up.
    pub fn step(&mut self, observe: Observe<'_>, go_on: GoOn<'_>) -> Result<(), SceneError> {
        let stepped = self.stepped(observe, go_on);
        if stepped.is_err() {
            self.give_up();
        }
        stepped
    }

    fn stepped(&mut self, observe: Observe<'_>, go_on: GoOn<'_>) -> Result<(), SceneError> {
        let (begun, next) = (Instant::now(), self.scene.step + 1);
        while self.ended.is_none() {
            match self.waiting.pop_front() {
                Some(News::Sensors { agent, values }) => {
                    self.sensed(agent, values, observe)?;
                }
                Some(News::Scene(scene)) if scene.step >= next => {
                    self.missing += scene.step - next;
                    self.scene = *scene;
                    return self.look_ahead(go_on);
                }
                // The scene is late or duplicated.
                Some(News::Scene(_)) => {}
                None if self.settled() => self.end(),
                None => {
                    self.wait(go_on)?;
                    if begun.elapsed() > MOST_STEPS * self.options.step {
                        return Err(self.silent("sent no scene"));
                    }
                }
            }
        }
        Ok(())
    }

    fn sensed(
        &mut self,
        agent: usize,
        values: Vec<f32>,
        observe: Observe<'_>,
    ) -> Result<(), SceneError> {
        let (server, controller) = (self.server, &self.options.controller);
        if !controller.steers() {
            return Err(Impossible(format!(
                "server {server} asks for actuators of agent {agent}, but a parameter set steers none"
            )));
        }
        if controller.team().is_none() && values.len() != controller.sensors() {
            return Err(Impossible(format!(
                "server {server}: agent {agent} has {} sensors, the controller {}; use a controller that was made for it",
                values.len(),
                controller.sensors()
            )));
        }
        if agent >= self.agents.len() {
            self.agents.resize_with(agent + 1, Acted::default);
        }
        let acted = &self.agents[agent];
        // The message is a duplicate. Actuator messages have no step number, so they must not be sent twice.
        if acted.step == Some(self.scene.step) && acted.sensors == values {
            return Ok(());
        }
        self.act(agent, values, observe)
    }

    /// Steps the controller of an agent and sends its actuators.
    fn act(
        &mut self,
        agent: usize,
        values: Vec<f32>,
        observe: Observe<'_>,
    ) -> Result<(), SceneError> {
        let prototype = &self.options.controller;
        let acted = &mut self.agents[agent];
        let server = self.server;
        let wrong = |error| Impossible(format!("server {server}: agent {agent}: {error}"));
        let controller = self.controllers.of(agent as u32).map_err(wrong)?;
        acted.actuators.resize(controller.actuators(), 0.0);
        controller
            .step(&values, &mut acted.actuators)
            .map_err(wrong)?;
        acted.step = Some(self.scene.step);
        acted.sensors = values;
        // Pad all rows to those of the agent with the most values.
        let (mut sensors, mut actuators) = (acted.sensors.clone(), acted.actuators.clone());
        sensors.resize(prototype.sensors(), 0.0);
        actuators.resize(prototype.actuators(), 0.0);
        observe(agent as u32, &sensors, &actuators);
        let payload = self.writer.encode(agent as u64, &acted.actuators);
        self.send(Topic::Actuator, &payload)
    }

    /// Waits for messages of the episode, at most for 0.1 s.
    fn wait(&mut self, go_on: GoOn<'_>) -> Result<(), SceneError> {
        let mut limit = self.heard + self.options.step;
        if let Some((_, came)) = &self.fitness {
            limit = limit.min(*came + OVERTAKEN);
        } else if Instant::now() >= limit {
            return Err(self.silent("sent nothing"));
        }
        self.receive(limit, go_on)
    }

    fn silent(&self, problem: &str) -> SceneError {
        Lost(format!(
            "server {} {problem} for {:.1} s after step {}",
            self.server,
            self.options.step.as_secs_f64(),
            self.scene.step
        ))
    }

    /// Ends the episode on the server, if it has not ended.
    fn give_up(&mut self) {
        if self.ended.is_none() {
            self.free();
        }
    }

    /// Ends the episode on the server, or frees the server, which stays reserved for this tool for some seconds after
    /// an episode.
    fn free(&mut self) {
        if self.control(false, None).is_ok() {
            self.connection.poll(Instant::now(), &mut self.events);
            self.events.clear();
        }
    }

    /// Returns whether the episode has ended.
    #[must_use]
    pub fn done(&self) -> bool {
        self.ended.is_some()
    }

    /// Returns the fitness so far; NaN if the server does not report it.
    #[must_use]
    pub fn fitness(&self) -> f64 {
        let so_far = self.scene.fitness.unwrap_or(f64::NAN);
        self.ended.as_ref().map_or(so_far, |(fitness, _)| *fitness)
    }

    /// Returns the metrics so far, as reported by the server.
    #[must_use]
    pub fn metrics(&self) -> &BTreeMap<String, f64> {
        self.ended
            .as_ref()
            .map_or(&self.scene.metrics, |(_, metrics)| metrics)
    }

    /// Returns the current scene.
    #[must_use]
    pub fn scene(&self) -> &SceneMessage {
        &self.scene
    }

    /// Returns the id of the server.
    #[must_use]
    pub fn server(&self) -> u64 {
        self.server
    }

    /// Returns the number of scenes before the current one that are missing.
    #[must_use]
    pub fn missing(&self) -> u64 {
        self.missing
    }

    /// Returns the state of each agent's state machine, see [`SwarmControllers::machine_states`].
    #[must_use]
    pub fn machine_states(&self) -> Option<Vec<i32>> {
        self.controllers.machine_states()
    }

    /// Ends the episode on the server, if it has not ended, and disconnects.
    pub fn close(mut self) {
        self.give_up();
        self.connection.close(Duration::from_secs(1));
    }
}
