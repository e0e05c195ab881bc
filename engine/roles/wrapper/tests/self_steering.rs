//! Simulations that steer their agents themselves: no actuators are requested, the fitness is sent, and messages are
//! read in between.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::sync::Arc;
use std::time::Duration;

use common::{Server, architecture, batch, bits, object, request};
use proptest::prelude::*;
use serde_json::{Map, Value, json};
use swarmwright_controllers::Controller;
use swarmwright_protocol::{F32s, Message, RefusalKind, ToServer, Topic, U64s};
use swarmwright_worlds::{Minisim, Simulation, rollout};

fn set() -> Map<String, Value> {
    object(
        json!({"version": 1, "kind": "parameter_set", "parameters": [
        {"name": "avoidance", "type": "real"},
        {"name": "avoidanceRadius", "type": "real"},
        {"name": "evasion", "type": "categorical", "choices": ["away", "left", "right"]},
        {"name": "maxSteps", "type": "integer"}]}),
    )
}

fn world() -> Map<String, Value> {
    object(json!({"steering": "rule", "placement": "random", "numAgents": 3, "numDefenders": 2}))
}

fn minisim() -> Server {
    Server::new(vec![Box::<Minisim>::default()])
}

fn controllers(genomes: &[[f32; 4]]) -> Vec<Controller> {
    let architecture = Arc::new(architecture(&set()));
    let of_one = |genome: &[f32; 4]| {
        Controller::with_weights(&architecture, genome.as_slice().into()).unwrap()
    };
    genomes.iter().map(of_one).collect()
}

fn with_seed(seed: u64) -> Map<String, Value> {
    let mut parameters = world();
    parameters.insert("seed".to_owned(), seed.into());
    parameters
}

fn begin(server: &mut Server, parameters: &Map<String, Value>) {
    let address = json!({"server": 7, "simulation_hash": "h", "tool": "ada"});
    let mut message = parameters.clone();
    message.extend(object(address.clone()));
    server.say(Topic::Parameters, &Value::Object(message));
    server.say(Topic::Control, &address);
}

/// Returns the fitness of one episode, and how often the server read its messages before it ended.
fn stepwise(server: &mut Server, parameters: &Map<String, Value>) -> (f64, usize) {
    server.published.clear();
    begin(server, parameters);
    for looks in 0..1000 {
        for (topic, payload) in server.published.drain(..) {
            match Message::decode(topic, &payload).unwrap() {
                Message::Fitness(message) => return (message.fitness, looks),
                Message::Presence(_) => {}
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(
            server.machine.next_tick(),
            Some(server.now),
            "it goes on at once"
        );
        server.pass(Duration::ZERO);
    }
    panic!("no fitness")
}

fn batched(server: &mut Server, parameters: &Map<String, Value>, seeds: &[u64]) -> Vec<f64> {
    let mut message = batch(1);
    message.simulation = "minisim".to_owned();
    message.parameters = parameters.clone();
    message.seeds = U64s(seeds.to_vec());
    server.ask(ToServer::Start(message));
    for _ in 0..1000 {
        if let Some(message) = server.sensors().pop() {
            assert_eq!((message.error, message.failed), (None, vec![]));
            assert!(message.agents.0.is_empty(), "the first message is the last");
            assert_eq!(message.ended.0.len(), seeds.len());
            return message.fitness.0;
        }
        server.pass(Duration::ZERO);
    }
    panic!("no end")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_fitness_does_not_depend_on_how_parameters_come(
        candidates in prop::collection::vec((0.0f32..5.0, 0.0f32..6.0, 0u8..3, 1u8..30), 1..5),
        seeds in prop::collection::vec(any::<u64>(), 1..4),
    ) {
        let genomes: Vec<[f32; 4]> = candidates
            .iter()
            .map(|(avoidance, radius, evasion, steps)| [*avoidance, *radius, f32::from(*evasion), f32::from(*steps)])
            .collect();
        let mut expected = Vec::new();
        for controller in controllers(&genomes) {
            for seed in &seeds {
                expected.push(rollout(&mut Minisim::default(), &with_seed(*seed), &controller).unwrap());
            }
        }
        let mut server = minisim();
        let mut message = request(1);
        message.simulation = "minisim".to_owned();
        message.parameters = world();
        message.controller = set();
        message.genomes = F32s(genomes.concat());
        message.seeds = U64s(seeds.clone());
        server.evaluate(message);
        server.compute();
        let result = server.results().remove(0);
        prop_assert_eq!((&result.error, &result.failed), (&None, &vec![]));
        prop_assert_eq!(bits(&result.fitness.0), bits(&expected), "offloaded");

        let (mut one_by_one, mut in_batches) = (Vec::new(), Vec::new());
        for controller in controllers(&genomes) {
            in_batches.extend(batched(&mut server, &controller.merged(&world()), &seeds));
            for seed in &seeds {
                one_by_one.push(stepwise(&mut server, &controller.merged(&with_seed(*seed))).0);
            }
        }
        prop_assert_eq!(bits(&one_by_one), bits(&expected), "stepwise");
        prop_assert_eq!(bits(&in_batches), bits(&expected), "batched");
        prop_assert_eq!(&server.warnings, &Vec::<String>::new());
    }
}

#[test]
fn messages_are_read_between_two_steps() {
    let mut parameters =
        object(json!({"steering": "rule", "speedAgents": 0, "numDefenders": 0, "maxSteps": 20}));
    let (_, looks) = stepwise(&mut minisim(), &parameters);
    assert_eq!(looks, 20);
    // An episode of the greatest length can be ended early.
    parameters.insert("maxSteps".to_owned(), json!(10_000_000));
    let mut server = minisim();
    begin(&mut server, &parameters);
    for _ in 0..100 {
        server.pass(Duration::ZERO);
    }
    assert!(!server.answers(Some("bob")), "taken");
    let end = json!({"server": 7, "simulation_hash": "h", "run": false, "tool": "ada"});
    server.say(Topic::Control, &end);
    assert!(server.answers(Some("bob")), "free again");
    assert_eq!(server.warnings, Vec::<String>::new());
}

#[test]
fn a_parameter_set_where_agents_wait_is_refused_with_the_cure() {
    let mut server = minisim();
    let mut message = request(1);
    message.simulation = "minisim".to_owned();
    message.controller = set();
    message.genomes = F32s(vec![1.0, 2.0, 0.0, 15.0]);
    server.evaluate(message);
    server.compute();
    let refusal = server.results().remove(0).error.unwrap();
    assert_eq!(refusal.kind, RefusalKind::Invalid);
    assert!(
        refusal.reason.contains("steering: rule"),
        "{}",
        refusal.reason
    );
}

/// A simulation that steers itself and fails at its third step.
struct Broken(u32);

impl Simulation for Broken {
    fn description(&self) -> swarmwright_worlds::Description {
        Minisim::default().description()
    }
    fn reset(&mut self, _: &Map<String, Value>) -> Result<(), swarmwright_worlds::ParameterError> {
        self.0 = 0;
        Ok(())
    }
    fn acting(&self) -> &[u32] {
        &[]
    }
    fn done(&self) -> bool {
        false
    }
    fn sense(&self, _: u32, _: &mut [f32]) {}
    fn step(&mut self, _: &[f32]) {
        self.0 += 1;
        assert!(self.0 < 3, "out of fuel");
    }
    fn fitness(&self) -> f64 {
        0.0
    }
}

#[test]
fn a_simulation_that_fails_by_itself_ends_its_episode() {
    let mut server = Server::new(vec![Box::new(Broken(0))]);
    begin(&mut server, &Map::new());
    server.pass(Duration::ZERO);
    server.pass(Duration::ZERO);
    assert!(
        server.warnings[0].contains("out of fuel"),
        "{:?}",
        server.warnings
    );
    let mut message = batch(1);
    message.simulation = "minisim".to_owned();
    message.seeds = U64s(vec![1]);
    server.ask(ToServer::Start(message));
    server.pass(Duration::ZERO);
    server.pass(Duration::ZERO);
    let failed = &server.sensors().remove(0).failed;
    assert!(failed[0].reason.contains("out of fuel"), "{failed:?}");
}
