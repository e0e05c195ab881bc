//! The server with a real broker: it keeps answering while it computes.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use common::{Walk, batch, bits, request};
use serde_json::json;
use swarmwright_broker::{Broker, Config};
use swarmwright_mqtt::{Connection, Event, QoS, Settings, Subscription};
use swarmwright_protocol::{Evaluated, RefusalKind, ToServer, ToTool, Topics, U64s};
use swarmwright_worlds::{Description, ParameterError, Parameters, Simulation};
use swarmwright_wrapper::{Options, SimulationServer};

const PATIENCE: Duration = Duration::from_secs(20);

/// A walk with slow steps.
struct Slow(Walk, Duration);

impl Simulation for Slow {
    fn description(&self) -> Description {
        self.0.description()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        thread::sleep(self.1);
        self.0.reset(parameters)
    }

    fn acting(&self) -> &[u32] {
        self.0.acting()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        self.0.sense(agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        self.0.step(actuators);
    }

    fn fitness(&self) -> f64 {
        self.0.fitness()
    }
}

/// Connection of a tool, and the received events that have not been examined.
struct Tool(Connection, Vec<Event>);

impl Tool {
    fn new(broker: &Broker, filter: &str) -> Self {
        let subscription = Subscription {
            filter: filter.to_owned(),
            qos: QoS::AtMostOnce,
        };
        let settings = Settings::new(broker.url().parse().unwrap());
        Self(
            Connection::open(settings, vec![subscription]).unwrap(),
            Vec::new(),
        )
    }

    fn publish(&mut self, topic: &str, payload: &[u8]) {
        self.0.publish(topic, payload, QoS::AtMostOnce, false, None);
        self.0.poll(Instant::now(), &mut self.1);
    }

    fn ask(&mut self, message: ToServer) {
        self.publish(&Topics::default().to_server(common::ID), &message.encode());
    }

    fn next(&mut self) -> Vec<u8> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            while !self.1.is_empty() {
                if let Event::Message(message) = self.1.remove(0) {
                    return message.payload().to_vec();
                }
            }
            assert!(Instant::now() < deadline, "nothing came");
            self.0.poll(deadline, &mut self.1);
        }
    }

    fn result(&mut self) -> Evaluated {
        match ToTool::decode(&self.next()).unwrap() {
            ToTool::Evaluated(message) => message,
            other => panic!("{other:?}"),
        }
    }
}

/// Runs a server while `test` runs.
fn with_server(simulation: Box<dyn Simulation>, test: impl FnOnce(&Broker)) {
    let broker = Broker::start(&Config::default()).unwrap();
    let options = Options::new(common::ID, &broker.url()).unwrap();
    let server = SimulationServer::connect(vec![simulation], options).unwrap();
    let going = Arc::new(AtomicBool::new(true));
    let serving = {
        let going = Arc::clone(&going);
        thread::spawn(move || server.run(|_| {}, || going.load(Ordering::Relaxed)))
    };
    test(&broker);
    going.store(false, Ordering::Relaxed);
    serving.join().unwrap().unwrap();
}

#[test]
fn short_and_long_evaluations_come_back_in_order() {
    with_server(Walk::duplicable(), |broker| {
        let mut tool = Tool::new(broker, "swarmwright/v1/tool/ada1");
        let mut fitness = Vec::new();
        for number in 0..400 {
            let mut message = request(number);
            // Some take a millisecond or more, and go to the other thread.
            let episodes = if number % 40 == 7 { 20_000 } else { 3 };
            message.seeds = U64s((0..episodes).collect());
            tool.ask(ToServer::Evaluate(message));
        }
        for number in 0..400 {
            let result = tool.result();
            assert_eq!((result.request, result.error), (number, None));
            fitness.push(bits(&result.fitness.0[..3]));
        }
        assert!(fitness.windows(2).all(|pair| pair[0] == pair[1]));
    });
}

#[test]
fn others_are_answered_while_a_long_evaluation_runs() {
    let second = Duration::from_secs(1);
    with_server(Box::new(Slow(Walk::default(), second)), |broker| {
        let mut ada = Tool::new(broker, "swarmwright/v1/tool/ada1");
        let mut bob = Tool::new(broker, "swarmwright/v1/tool/bob1");
        let start = Instant::now();
        let mut long = request(1);
        long.seeds = U64s(vec![5]);
        ada.ask(ToServer::Evaluate(long));
        thread::sleep(second / 4);
        let mut other = request(2);
        other.tool = "bob".to_owned();
        other.reply = "swarmwright/v1/tool/bob1".to_owned();
        bob.ask(ToServer::Evaluate(other));
        let refusal = bob.result().error.unwrap();
        assert_eq!(refusal.kind, RefusalKind::Taken);
        assert!(start.elapsed() < second, "{:?}", start.elapsed());
        let result = ada.result();
        assert_eq!((result.request, result.fitness.0.len()), (1, 2));
        assert!(start.elapsed() >= 2 * second && result.seconds >= 2.0);
    });
}

#[test]
fn what_is_given_back_stops_within_an_episode() {
    let pause = Duration::from_millis(100);
    with_server(Box::new(Slow(Walk::default(), pause)), |broker| {
        let mut ada = Tool::new(broker, "swarmwright/v1/tool/ada1");
        let mut long = request(1);
        long.seeds = U64s((0..10_000).collect());
        ada.ask(ToServer::Evaluate(long));
        thread::sleep(pause);
        let end = json!({"server": common::ID, "simulation_hash": "", "run": false, "tool": "ada"});
        ada.publish("control", end.to_string().as_bytes());
        // The server is free once the current episode has ended.
        let mut bob = Tool::new(broker, "server");
        let asked = Instant::now();
        let discovery = json!({"simulation": "walk", "simulation_hash": "b", "requirements": {"dimensions": 2}});
        let asking = thread::spawn({
            let mut third = Tool::new(broker, "nothing");
            move || {
                for _ in 0..50 {
                    third.publish("discovery", discovery.to_string().as_bytes());
                    thread::sleep(Duration::from_millis(50));
                }
            }
        });
        bob.next();
        assert!(
            asked.elapsed() < Duration::from_secs(2),
            "{:?}",
            asked.elapsed()
        );
        asking.join().unwrap();
    });
}

#[test]
fn a_batch_is_stepped_over_the_broker() {
    with_server(Walk::duplicable(), |broker| {
        let mut tool = Tool::new(broker, "swarmwright/v1/tool/ada1");
        tool.ask(ToServer::Start(batch(3)));
        let mut ended = 0;
        for step in 0.. {
            let ToTool::Sensors(message) = ToTool::decode(&tool.next()).unwrap() else {
                panic!("no sensors")
            };
            assert_eq!((message.step, message.error), (step, None));
            ended += message.ended.0.len();
            if message.agents.0.is_empty() {
                break;
            }
            tool.ask(ToServer::Actuators(swarmwright_protocol::BatchActuators {
                version: 1,
                request: 3,
                step,
                actuators: swarmwright_protocol::F32s(vec![0.5; message.agents.0.len()]),
            }));
        }
        assert_eq!(ended, 3);
    });
}
