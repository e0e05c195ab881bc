//! A broker, a clock and parties without I/O: whole conversations between pools and servers in virtual time.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};
use swarmwright_controllers::{Controller, Specification};
use swarmwright_pool::{Config, Demand, Machine as PoolMachine, Outcome, Task};
use swarmwright_protocol::{Requirements, Topic, Topics};
use swarmwright_worlds::{Description, ParameterError, Parameters, Simulation};
use swarmwright_wrapper::{Identity, Machine as ServerMachine, Notice};

/// Agents on a line: each moves by its actuator; the fitness is the sum of the places, weighted by agent and seed.
pub struct Line {
    places: Vec<f32>,
    acting: Vec<u32>,
    step: u32,
    seed: f32,
    pub sensors: usize,
}

impl Line {
    pub fn new() -> Self {
        Self {
            places: Vec::new(),
            acting: Vec::new(),
            step: 0,
            seed: 0.0,
            sensors: 2,
        }
    }
}

impl Simulation for Line {
    fn description(&self) -> Description {
        Description {
            title: "line".into(),
            dimensions: 2,
            max_agents: Some(100),
            sensors: self.sensors,
            actuators: 1,
        }
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let number = |name: &str| parameters.get(name).and_then(Value::as_f64).unwrap_or(0.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "small numbers"
        )]
        let agents = number("numAgents") as usize;
        if agents == 0 {
            return Err(ParameterError {
                name: "numAgents".into(),
                reason: "must be 1 or more".into(),
            });
        }
        #[expect(clippy::cast_possible_truncation, reason = "small numbers")]
        let seed = number("seed") as f32;
        self.seed = seed;
        self.places = vec![0.0; agents];
        self.acting = (0..u32::try_from(agents).unwrap()).collect();
        self.step = 0;
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        &self.acting
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        sensors.fill(self.seed);
        sensors[0] = self.places[agent as usize];
    }

    fn step(&mut self, actuators: &[f32]) {
        for (&agent, actuator) in self.acting.iter().zip(actuators) {
            self.places[agent as usize] += actuator;
        }
        self.step += 1;
        // Agents stop one after another, so that the number of messages changes from step to step.
        let step = self.step;
        self.acting.retain(|&agent| agent % 4 + 3 > step);
    }

    fn fitness(&self) -> f64 {
        self.places
            .iter()
            .enumerate()
            .map(|(agent, &place)| f64::from(place) * (agent + 1) as f64)
            .sum()
    }
}

/// A controller of the given weight, without state.
pub fn controller(weight: f32) -> Controller {
    let specification = json!({"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1], "weights": [weight, -weight, 0.5]});
    Controller::new(&Specification::from_json(&specification.to_string()).unwrap())
}

pub fn tasks(candidates: usize, episodes: usize) -> Vec<Task> {
    (0..candidates)
        .flat_map(|candidate| {
            (0..episodes).map(move |episode| Task {
                candidate,
                episode,
                controller: controller(candidate as f32 / 10.0),
            })
        })
        .collect()
}

/// Topic and payload in, topics and payloads out.
pub type Script = Box<dyn FnMut(&str, &[u8]) -> Vec<(String, String)>>;

pub enum Party {
    Tool(Box<PoolMachine>),
    Server(Box<ServerMachine>),
    /// Answers each message as it likes.
    Script(Script),
    /// Neither reads nor writes: frozen or killed.
    Gone,
}

#[derive(Clone)]
pub struct Message {
    pub from: usize,
    pub topic: String,
    pub payload: Vec<u8>,
}

/// The broker and everybody on it. Messages of one party stay in their order, as on a TCP connection; whose message
/// comes next is drawn.
pub struct Net {
    pub now: Instant,
    pub parties: Vec<Party>,
    /// What the broker has yet to deliver, per sender.
    queues: Vec<VecDeque<Message>>,
    pub log: Vec<Message>,
    pub warnings: Vec<String>,
    random: u64,
}

pub fn tool(name: &str, first_instance: u64, now: Instant) -> PoolMachine {
    let mut parameters = Map::new();
    parameters.insert("numAgents".into(), 5.into());
    PoolMachine::new(
        Config {
            demand: Demand {
                simulation: "line".into(),
                requirements: Requirements {
                    dimensions: 2.0,
                    max_agents: Some(5.0),
                },
                sensors: Some(2),
                actuators: Some(1),
            },
            parameters,
            tool: name.into(),
            topics: Topics::default(),
            visual: false,
            step_timeout: Duration::from_secs(10),
            attempts: 3,
            first_instance,
        },
        now,
    )
}

pub fn server(id: u64, simulation: Line) -> ServerMachine {
    ServerMachine::new(
        Identity::new(id),
        vec![Box::new(simulation)],
        Topics::default(),
        Duration::from_secs(20),
    )
}

impl Net {
    pub fn new(random: u64) -> Self {
        Self {
            now: Instant::now(),
            parties: Vec::new(),
            queues: Vec::new(),
            log: Vec::new(),
            warnings: Vec::new(),
            random: random.wrapping_mul(2).wrapping_add(1),
        }
    }

    pub fn add(&mut self, party: Party) -> usize {
        self.parties.push(party);
        self.queues.push(VecDeque::new());
        self.collect(self.parties.len() - 1);
        self.parties.len() - 1
    }

    pub fn tool(&mut self, index: usize) -> &mut PoolMachine {
        match &mut self.parties[index] {
            Party::Tool(machine) => machine,
            _ => panic!("party {index} is no tool"),
        }
    }

    fn draw(&mut self, below: usize) -> usize {
        // xorshift64*: any mixing will do.
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        usize::try_from(self.random.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33).unwrap() % below
    }

    pub fn publish(&mut self, from: usize, topic: &str, payload: &[u8]) {
        self.queues[from].push_back(Message {
            from,
            topic: topic.into(),
            payload: payload.into(),
        });
    }

    /// Takes what a party wants done.
    pub fn collect(&mut self, index: usize) {
        let topics = Topics::default();
        let mut published = Vec::new();
        match &mut self.parties[index] {
            Party::Tool(machine) => {
                for action in machine.actions() {
                    match action {
                        swarmwright_pool::Action::Publish(topic, payload) => {
                            published.push((topics.name(topic), payload))
                        }
                        swarmwright_pool::Action::Warn(text) => self.warnings.push(text),
                    }
                }
            }
            Party::Server(machine) => {
                for action in machine.actions() {
                    match action {
                        // Presence has its own tests; conversations must work without it.
                        swarmwright_wrapper::Action::Publish(Topic::Presence, _) => {}
                        swarmwright_wrapper::Action::Publish(topic, payload) => {
                            published.push((topics.name(topic), payload))
                        }
                        swarmwright_wrapper::Action::Notice(Notice::Warning(text)) => {
                            self.warnings.push(text)
                        }
                        swarmwright_wrapper::Action::Notice(_)
                        | swarmwright_wrapper::Action::Frame(_) => {}
                    }
                }
            }
            Party::Script(_) | Party::Gone => {}
        }
        for (topic, payload) in published {
            self.publish(index, &topic, &payload);
        }
    }

    fn deliver(&mut self, message: &Message) {
        for index in 0..self.parties.len() {
            if index == message.from {
                continue;
            }
            match &mut self.parties[index] {
                Party::Tool(machine) => {
                    machine.receive(&message.topic, &message.payload, false, self.now)
                }
                Party::Server(machine) => {
                    machine.receive(&message.topic, &message.payload, false, self.now)
                }
                Party::Script(script) => {
                    for (topic, text) in script(&message.topic, &message.payload) {
                        self.queues[index].push_back(Message {
                            from: index,
                            topic,
                            payload: text.into_bytes(),
                        });
                    }
                }
                Party::Gone => {}
            }
            self.collect(index);
        }
    }

    fn next_tick(&self) -> Option<Instant> {
        self.parties
            .iter()
            .filter_map(|party| match party {
                Party::Tool(machine) => Some(machine.next_tick()),
                Party::Server(machine) => machine.next_tick(),
                Party::Script(_) | Party::Gone => None,
            })
            .min()
    }

    /// Delivers one message, or lets time pass to the next timer.
    pub fn turn(&mut self) {
        let waiting: Vec<usize> = (0..self.queues.len())
            .filter(|&index| !self.queues[index].is_empty())
            .collect();
        if waiting.is_empty() {
            self.now =
                self.next_tick().map_or(self.now, |at| at.max(self.now)) + Duration::from_micros(1);
            for index in 0..self.parties.len() {
                match &mut self.parties[index] {
                    Party::Tool(machine) => machine.tick(self.now),
                    Party::Server(machine) => machine.tick(self.now, String::new),
                    Party::Script(_) | Party::Gone => {}
                }
                self.collect(index);
            }
            return;
        }
        let drawn = waiting[self.draw(waiting.len())];
        let Some(message) = self.queues[drawn].pop_front() else {
            return;
        };
        self.now += Duration::from_micros(50);
        self.log.push(message.clone());
        self.deliver(&message);
    }

    /// Turns until the tool has all its outcomes.
    pub fn finish(&mut self, tool: usize) -> Vec<Outcome> {
        for _ in 0..2_000_000 {
            if self.tool(tool).finished() {
                return self.tool(tool).take_outcomes();
            }
            self.turn();
        }
        panic!(
            "no end in sight; {}; {:?}",
            self.tool(tool).describe(),
            self.warnings
        );
    }

    pub fn submit(&mut self, tool: usize, tasks: Vec<Task>, seeds: &[u64]) {
        let now = self.now;
        self.tool(tool).submit(tasks, seeds, now);
        self.collect(tool);
    }
}
