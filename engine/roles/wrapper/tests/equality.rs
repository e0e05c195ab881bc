//! Stepwise, batched, offloaded and in-process evaluation give bitwise the same fitness.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::collections::HashMap;
use std::sync::Arc;

use common::{Server, Walk, architecture, batch, bits, object, request};
use proptest::prelude::*;
use serde_json::{Map, Value, json};
use swarmwright_controllers::{Architecture, Controller};
use swarmwright_protocol::{F32s, Message, ToServer, Topic, U64s};
use swarmwright_worlds::{Simulation, create, rollout};

fn simulation(title: &str) -> Box<dyn Simulation> {
    create(title).unwrap_or_else(Walk::duplicable)
}

struct Case {
    title: &'static str,
    parameters: Map<String, Value>,
    controller: Map<String, Value>,
    genomes: Vec<f32>,
    seeds: Vec<u64>,
}

impl Case {
    fn architecture(&self) -> Arc<Architecture> {
        Arc::new(architecture(&self.controller))
    }

    fn controllers(&self) -> Vec<Controller> {
        let architecture = self.architecture();
        self.genomes
            .chunks(architecture.weight_count())
            .map(|genome| Controller::with_weights(&architecture, genome.into()).unwrap())
            .collect()
    }

    fn with_seed(&self, seed: u64) -> Map<String, Value> {
        let mut parameters = self.parameters.clone();
        parameters.insert("seed".to_owned(), seed.into());
        parameters
    }

    fn in_process(&self) -> Vec<f64> {
        let mut simulation = simulation(self.title);
        let mut fitness = Vec::new();
        for controller in self.controllers() {
            for seed in &self.seeds {
                fitness
                    .push(rollout(&mut *simulation, &self.with_seed(*seed), &controller).unwrap());
            }
        }
        fitness
    }

    fn offloaded(&self, server: &mut Server) -> Vec<f64> {
        let mut message = request(1);
        message.simulation = self.title.to_owned();
        message.parameters = self.parameters.clone();
        message.controller = self.controller.clone();
        message.genomes = F32s(self.genomes.clone());
        message.seeds = U64s(self.seeds.clone());
        server.evaluate(message);
        server.compute();
        let result = server.results().remove(0);
        assert_eq!((result.error, result.failed), (None, vec![]));
        result.fitness.0
    }

    /// Evaluates a batch per candidate, with an episode per seed.
    fn batched(&self, server: &mut Server) -> Vec<f64> {
        let mut all = Vec::new();
        for (number, controller) in (0..).zip(self.controllers()) {
            let mut message = batch(number);
            message.simulation = self.title.to_owned();
            message.parameters = self.parameters.clone();
            message.seeds = U64s(self.seeds.clone());
            server.ask(ToServer::Start(message));
            let mut fitness = vec![f64::NAN; self.seeds.len()];
            let mut controllers: HashMap<(u32, u32), Controller> = HashMap::new();
            loop {
                let message = server.sensors().remove(0);
                assert_eq!((message.error, message.failed), (None, vec![]));
                for (episode, value) in message.ended.0.iter().zip(message.fitness.0) {
                    fitness[*episode as usize] = value;
                }
                if message.agents.0.is_empty() {
                    break;
                }
                let mut actuators = vec![0.0; message.agents.0.len() * controller.actuators()];
                let rows = message.episodes.0.iter().zip(&message.agents.0);
                for (row, (episode, agent)) in rows.enumerate() {
                    let sensors =
                        &message.sensors.0[row * controller.sensors()..][..controller.sensors()];
                    let row_actuators =
                        &mut actuators[row * controller.actuators()..][..controller.actuators()];
                    controllers
                        .entry((*episode, *agent))
                        .or_insert_with(|| controller.clone())
                        .step(sensors, row_actuators)
                        .unwrap();
                }
                server.actuators(number, message.step, actuators);
            }
            all.extend(fitness);
        }
        all
    }

    fn stepwise(&self, server: &mut Server) -> Vec<f64> {
        let mut all = Vec::new();
        for controller in self.controllers() {
            for seed in &self.seeds {
                let address = json!({"server": 7, "simulation_hash": "h", "tool": "ada"});
                let mut parameters = self.with_seed(*seed);
                parameters.extend(object(address.clone()));
                server.say(Topic::Parameters, &Value::Object(parameters));
                server.say(Topic::Control, &address);
                let mut controllers: HashMap<u64, Controller> = HashMap::new();
                let fitness = loop {
                    let mut ended = None;
                    let mut actuators = Vec::new();
                    for (topic, payload) in server.published.drain(..) {
                        match Message::decode(topic, &payload).unwrap() {
                            Message::Sensor(message) => {
                                let mut row = vec![0.0; controller.actuators()];
                                controllers
                                    .entry(message.agent)
                                    .or_insert_with(|| controller.clone())
                                    .step(&message.sensor, &mut row)
                                    .unwrap();
                                actuators.push(json!({"simulation_hash": "h", "agent": message.agent, "actuator": row}));
                            }
                            Message::Fitness(message) => ended = Some(message.fitness),
                            _ => {}
                        }
                    }
                    if let Some(fitness) = ended {
                        break fitness;
                    }
                    assert!(!actuators.is_empty(), "{:?}", server.warnings);
                    for message in actuators {
                        server.say(Topic::Actuator, &message);
                    }
                };
                all.push(fitness);
            }
        }
        all
    }
}

fn check(case: &Case) {
    let mut server = Server::new(vec![simulation(case.title)]);
    let expected = case.in_process();
    assert_eq!(
        bits(&case.offloaded(&mut server)),
        bits(&expected),
        "offloaded"
    );
    assert_eq!(bits(&case.batched(&mut server)), bits(&expected), "batched");
    assert_eq!(
        bits(&case.stepwise(&mut server)),
        bits(&expected),
        "stepwise"
    );
    assert_eq!(
        bits(&case.offloaded(&mut server)),
        bits(&expected),
        "offloaded again"
    );
    assert_eq!(server.warnings, Vec::<String>::new());
}

fn network() -> impl Strategy<Value = Value> {
    let layered = (prop::collection::vec(1usize..5, 0..3), prop::sample::select(vec!["tanh", "relu", "linear"]))
        .prop_map(|(hidden, activation)| json!({"kind": "layered", "hidden": hidden, "activation": activation}));
    let meshed = (0usize..4, 1u32..4, prop::sample::select(vec!["clamp", "sigmoid"])).prop_map(
        |(hidden, iterations, activation)| {
            json!({"kind": "fully_meshed", "hidden": hidden, "iterations": iterations, "activation": activation})
        },
    );
    let network = prop_oneof![layered, meshed].prop_map(|mut network| {
        network["output_range"] = json!([-1, 1]);
        network
    });
    // The machine uses only the first two sensors.
    let machine = (1usize..4, prop::sample::select(vec![vec![0.0], vec![-0.2, 0.3]])).prop_map(
        |(states, cut)| json!({"kind": "mealy_fsm", "states": states, "thresholds": [cut, [0.1]]}),
    );
    let evostick = Just(json!({"kind": "evostick"}));
    let hebbian = (0usize..4, 1u32..4).prop_map(
        |(hidden, iterations)| json!({"kind": "hebbian", "hidden": hidden, "iterations": iterations}),
    );
    // Counted from the last node, which is an actuator; worlds here have at most two actuators and at least two
    // sensors.
    let hears = prop::collection::vec(0usize..4, 0..5);
    let neat = (prop::collection::vec(hears, 2..5), 1u32..4).prop_map(
        |(sources, iterations)| json!({"kind": "neat", "sources": sources, "iterations": iterations}),
    );
    prop_oneof![3 => network, 1 => machine, 1 => evostick, 1 => hebbian, 1 => neat]
}

fn world() -> impl Strategy<Value = (&'static str, Value, usize, usize)> {
    prop_oneof![
        (1u32..5, 0u32..3, 1u32..12).prop_map(|(agents, defenders, steps)| (
            "minisim",
            json!({"numAgents": agents, "numDefenders": defenders, "maxSteps": steps, "placement": "random"}),
            4,
            1
        )),
        (1u32..6, 1u32..10, any::<bool>()).prop_map(|(agents, steps, turns)| (
            "emergency_exit",
            json!({"numAgents": agents, "steps": steps, "width": 8, "height": 8, "numBlockades": 5,
                "update": if turns { "sequential" } else { "simultaneous" }}),
            10,
            2
        )),
        (1u32..6).prop_map(|agents| ("walk", json!({"agents": agents}), 2, 1)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_fitness_does_not_depend_on_where_the_controller_is(
        mut network in network(), (title, parameters, sensors, actuators) in world(),
        weights in prop::collection::vec(-3.0f32..3.0, 400), candidates in 1usize..4, first in any::<u32>(), episodes in 1u64..4,
    ) {
        if let Some(rows) = network.get_mut("sources").and_then(Value::as_array_mut) {
            let last = sensors + rows.len() - 1;
            for number in rows.iter_mut().filter_map(Value::as_array_mut).flatten() {
                *number = json!(last - number.as_u64().unwrap() as usize);
            }
        }
        for (key, value) in [("version", 1), ("sensors", sensors), ("actuators", actuators)] {
            network[key] = json!(value);
        }
        if let Some(thresholds) = network.get_mut("thresholds").and_then(Value::as_array_mut) {
            thresholds.resize(sensors, json!([]));
        }
        let controller = object(network);
        let length = architecture(&controller).weight_count();
        let candidates = candidates.min(weights.len() / length);
        prop_assume!(candidates > 0);
        check(&Case {
            title,
            parameters: object(parameters),
            controller,
            genomes: weights[..candidates * length].to_vec(),
            seeds: (0..episodes).map(|episode| u64::from(first) + episode).collect(),
        });
    }
}
